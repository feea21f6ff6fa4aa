//! Which values a key takes: said once, for readers and for the [schema](super::schema).

use std::f64::consts::FRAC_PI_2;
use std::fmt;

/// The values that a key takes. Shown, it is what the manual says of them.
#[derive(Clone, Copy, Debug)]
pub enum Form {
    /// `true` or `false`.
    Boolean,
    /// A number.
    Number(Range),
    /// An integer.
    Integer(Range),
    /// One of these names.
    Choice(&'static [&'static str]),
    /// A string; what it stands for.
    Text(&'static str),
    /// The name of a kind, of which each has keys of its own.
    Kind,
    /// So many values.
    Array(usize, &'static Form),
    /// A list of values; what it is of.
    List(&'static str, &'static Form),
    /// A table: the path of its [`Section`](super::Section)s.
    Table(&'static str),
    /// Tables of one path, by names of the scene's own.
    Named(&'static str),
    /// Keys of a scene, in whatever way a scene says them, and their values.
    Keys,
    /// Any of these.
    OneOf(&'static [Form]),
    /// These values, in words of its own.
    Said(&'static str, &'static Form),
}

/// Numbers.
#[derive(Clone, Copy, Debug)]
pub enum Range {
    /// All.
    Any,
    /// Above.
    Above(f64),
    /// This, and above.
    AtLeast(f64),
    /// From the one to the other, both allowed.
    Within(f64, f64),
    /// Above the one, below the other.
    Between(f64, f64),
    /// From the one, below the other.
    HalfOpen(f64, f64),
    /// Above the one, up to the other.
    AboveUpTo(f64, f64),
}

impl fmt::Display for Form {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Form::Boolean => f.write_str("true or false"),
            Form::Number(range) => write!(f, "a number{range}"),
            Form::Integer(range) => write!(f, "an integer{range}"),
            Form::Choice(names) => joined(f, names.iter().map(|name| format!("{name:?}")), " or "),
            Form::Text(what) | Form::Said(what, _) => f.write_str(what),
            Form::Kind => f.write_str("the name of a kind"),
            Form::Array(length, of) => write!(f, "{length} values, each {of}"),
            Form::List(of, _) => write!(f, "a list of {of}"),
            Form::Table(_) => f.write_str("a table"),
            Form::Named(_) => f.write_str("a table of tables, by name"),
            Form::Keys => f.write_str("a table of keys and values"),
            Form::OneOf(forms) => joined(f, forms.iter().map(Form::to_string), ", or "),
        }
    }
}

/// Words with commas between them, and `last` before the last.
fn joined(f: &mut fmt::Formatter<'_>, words: impl Iterator<Item = String>, last: &str) -> fmt::Result {
    let words: Vec<String> = words.collect();
    match words.split_last() {
        Some((word, [])) => f.write_str(word),
        Some((word, before)) => write!(f, "{}{last}{word}", before.join(", ")),
        None => Ok(()),
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.map(said) {
            Bounds { low: None, .. } => Ok(()),
            Bounds { low: Some((low, true)), high: Some((high, true)) } => write!(f, " from {low} to {high}"),
            Bounds { low: Some((low, holds)), high } => {
                write!(f, " {} {low}", if holds { "of at least" } else { "above" })?;
                match high {
                    Some((high, true)) => write!(f, " and at most {high}"),
                    Some((high, false)) => write!(f, " and below {high}"),
                    None => Ok(()),
                }
            }
        }
    }
}

/// A number as the manual says it.
fn said(number: f64) -> String {
    if number == FRAC_PI_2 {
        return "π/2".to_string();
    }
    if number != 0.0 && number.abs() < 1e-3 { format!("{number:e}") } else { number.to_string() }
}

/// The ends of a range, and whether they belong to it.
pub(super) struct Bounds<T> {
    pub(super) low: Option<(T, bool)>,
    pub(super) high: Option<(T, bool)>,
}

impl Range {
    /// Its ends, each made into something.
    pub(super) fn map<T>(self, of: impl Fn(f64) -> T) -> Bounds<T> {
        let (low, high) = match self {
            Range::Any => (None, None),
            Range::Above(low) => (Some((low, false)), None),
            Range::AtLeast(low) => (Some((low, true)), None),
            Range::Within(low, high) => (Some((low, true)), Some((high, true))),
            Range::Between(low, high) => (Some((low, false)), Some((high, false))),
            Range::HalfOpen(low, high) => (Some((low, true)), Some((high, false))),
            Range::AboveUpTo(low, high) => (Some((low, false)), Some((high, true))),
        };
        let end = |end: Option<(f64, bool)>| end.map(|(number, holds)| (of(number), holds));
        Bounds { low: end(low), high: end(high) }
    }
}

/// `[x, y, z]`
pub(super) const VECTOR: Form = Form::Said("[x, y, z]", &THREE);
/// `[x, y, z]`, not all 0.
pub(super) const DIRECTION: Form = Form::Said("[x, y, z], not 0", &THREE);
/// Three numbers, for forms that say more of them.
pub(super) const THREE: Form = Form::Array(3, &NUMBER);
pub(super) const NUMBER: Form = Form::Number(Range::Any);
pub(super) const POSITIVE: Form = Form::Number(Range::Above(0.0));
pub(super) const NON_NEGATIVE: Form = Form::Number(Range::AtLeast(0.0));
pub(super) const SHARE: Form = Form::Number(Range::Within(0.0, 1.0));
pub(super) const COUNT: Form = Form::Integer(Range::AtLeast(0.0));
pub(super) const POSITIVE_INTEGER: Form = Form::Integer(Range::AtLeast(1.0));
pub(super) const STRING: Form = Form::Text("a string");
/// A number of at least 0, or three of them.
pub(super) const COLOUR: Form = Form::OneOf(&[NON_NEGATIVE, COLOUR_CHANNELS]);
/// Three numbers of at least 0.
pub(super) const COLOUR_CHANNELS: Form = Form::Said("[r, g, b]", &Form::Array(3, &NON_NEGATIVE));
/// Three shares.
pub(super) const SHARE_CHANNELS: Form = Form::Said("[r, g, b]", &Form::Array(3, &SHARE));
/// A share, or three of them.
pub(super) const SHARE_COLOUR: Form = Form::OneOf(&[SHARE, SHARE_CHANNELS]);
/// A step of a transform after the other.
pub(super) const STEPS: Form = Form::List("steps", &Form::Table("shapes.*.transform.*"));
