//! What a check found: a table of rows, each passed, failed or not applicable.

use serde::Serialize;

/// How a row came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Nothing is wrong, as far as this test can tell.
    Pass,
    /// Something is.
    Fail,
    /// The test cannot tell, or there is nothing for it to test.
    NotApplicable,
}

/// A row of the table.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The test.
    pub test: String,
    /// How it came out.
    pub outcome: Outcome,
    /// The number it went by, where there is one; `found` says of what.
    pub number: Option<f64>,
    /// What was found, for a person.
    pub found: String,
    /// A command that shows more, where there is one.
    pub command: Option<String>,
    /// The p-values of all blocks, where there are such.
    pub map: Option<PMap>,
}

impl Row {
    /// A row without a number.
    pub fn new(test: impl Into<String>, outcome: Outcome, found: impl Into<String>) -> Row {
        Row { test: test.into(), outcome, number: None, found: found.into(), command: None, map: None }
    }

    /// A row that could not be decided.
    pub fn not_applicable(test: impl Into<String>, why: impl Into<String>) -> Row {
        Row::new(test, Outcome::NotApplicable, why)
    }

    /// This row with its number.
    pub fn with(self, number: f64) -> Row {
        Row { number: number.is_finite().then_some(number), ..self }
    }
}

/// p-values over the picture (Jung, Hanika and Dachsbacher 2020).
#[derive(Clone, Debug, Serialize)]
pub struct PMap {
    /// Pixels along the edge of a block.
    pub block: usize,
    /// Blocks across.
    pub columns: usize,
    /// Row by row from the top left, of the sum of all channels.
    pub p: Vec<f64>,
    /// How many p-values of blocks that are not dark lie in each tenth from 0 to 1: alike where nothing is wrong.
    pub histogram: [u32; 10],
}

/// What a check found.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The scene file.
    pub scene: String,
    /// Pixels across and down of the pictures that were compared.
    pub size: [u32; 2],
    /// Camera samples per pixel and seed.
    pub samples: u32,
    /// Seconds that the check took,
    pub seconds: f64,
    /// and those of all its threads together.
    pub thread_seconds: f64,
    /// Whether it came to its end.
    pub complete: bool,
    /// The table.
    pub rows: Vec<Row>,
    /// What the renderer warned about.
    pub warnings: Vec<String>,
}

impl Report {
    /// How many rows came out so.
    pub fn count(&self, outcome: Outcome) -> usize {
        self.rows.iter().filter(|row| row.outcome == outcome).count()
    }
}
