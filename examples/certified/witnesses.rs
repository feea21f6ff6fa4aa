//! What other people's programs say: `tests/data/certified.json`.

use std::error::Error;
use std::path::Path;

use serde_json::Value;

/// The tables of that file.
pub struct Witnesses(Value);

impl Witnesses {
    pub fn read() -> Result<Self, Box<dyn Error>> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/certified.json");
        Ok(Witnesses(serde_json::from_str(&std::fs::read_to_string(path)?)?))
    }

    fn value(&self, keys: &[&str]) -> &Value {
        keys.iter().fold(&self.0, |table, key| &table[*key])
    }

    /// A number, if it is known.
    pub fn number(&self, keys: &[&str]) -> Option<f64> {
        self.value(keys).as_f64()
    }

    /// A list of numbers that must be there.
    pub fn list(&self, keys: &[&str]) -> Result<Vec<f64>, Box<dyn Error>> {
        let list = self.value(keys).as_array().ok_or_else(|| format!("no list {}", keys.join(".")))?;
        list.iter()
            .map(|value| value.as_f64().ok_or_else(|| format!("{value} in {} is no number", keys.join(".")).into()))
            .collect()
    }
}
