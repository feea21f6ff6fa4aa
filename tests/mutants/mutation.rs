//! How files are damaged: the same number always makes the same of the same bytes.

use volpm::math::random::{Purpose, Stream};

/// Bytes, words and numbers that readers stumble over.
const BYTES: [u8; 6] = [0x00, 0x01, 0x7f, 0x80, 0xfe, 0xff];
const WORDS: [u32; 8] = [0, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x7f80_0000, 0x7fc0_0000, 0x0001_0000];
const LONGS: [u64; 6] = [0, u64::MAX, i64::MAX as u64, 1 << 32, 0x7ff0_0000_0000_0000, 0x0010_0000_0000_0000];
/// What stands for a number in a text: such as may be meant,
const LIKELY: [&str; 14] =
    ["0", "1", "2", "3", "-1", "0.5", "-0.5", "0.1", "0.9", "0.999999", "1e-3", "1e3", "1e-8", "1e8"];
/// and such as are not.
const UNLIKELY: [&str; 18] = [
    "-0.0",
    "1e30",
    "-1e30",
    "1e-30",
    "1e300",
    "1e-310",
    "nan",
    "inf",
    "-inf",
    "255",
    "65536",
    "1_000_000",
    "4294967295",
    "9223372036854775807",
    "-9223372036854775808",
    "[1, 2, 3]",
    "\"\"",
    "true",
];

/// Draws what is done.
struct Dice(Stream);

impl Dice {
    fn below(&mut self, count: usize) -> usize {
        ((self.0.uniform() * count as f64) as usize).min(count.saturating_sub(1))
    }

    fn number(&mut self) -> &'static str {
        if self.below(4) == 0 { self.of(&UNLIKELY) } else { self.of(&LIKELY) }
    }

    fn of<T: Copy>(&mut self, list: &[T]) -> T {
        list[self.below(list.len())]
    }

    /// A part of `length`, short more often than long.
    fn range(&mut self, length: usize) -> std::ops::Range<usize> {
        let from = self.below(length);
        let share = self.0.uniform();
        from..from + ((length - from) as f64 * share * share * share).ceil() as usize
    }
}

/// The mutant of this number of bytes: changed in one to four places.
pub fn of_bytes(bytes: &[u8], number: u64) -> Vec<u8> {
    let mut dice = Dice(Stream::new(1, Purpose::Test, number, 0));
    let mut bytes = bytes.to_vec();
    for _ in 0..=dice.below(4) {
        damage(&mut bytes, &mut dice);
    }
    bytes
}

fn damage(bytes: &mut Vec<u8>, dice: &mut Dice) {
    if bytes.is_empty() {
        return bytes.push(dice.of(&BYTES));
    }
    // Headers are short, and most can be done wrong there.
    let reach = if dice.below(2) == 0 { bytes.len().min(256) } else { bytes.len() };
    let at = dice.below(reach);
    let overwrite = |bytes: &mut [u8], new: &[u8]| bytes[at..].iter_mut().zip(new).for_each(|(byte, new)| *byte = *new);
    match dice.below(11) {
        0 => bytes[at] ^= 1 << dice.below(8),
        1 => bytes[at] = dice.of(&BYTES),
        2 => bytes[at] = dice.below(256) as u8,
        3 => overwrite(bytes, &dice.of(&WORDS).to_le_bytes()),
        4 => overwrite(bytes, &dice.of(&WORDS).to_be_bytes()),
        5 => overwrite(bytes, &dice.of(&LONGS).to_le_bytes()),
        6 => overwrite(bytes, &(dice.0.uniform() as f32 * 10.0 - 5.0).exp2().to_le_bytes()),
        7 => bytes.truncate(at),
        8 => drop(bytes.drain(dice.range(reach))),
        9 => {
            let part = bytes[dice.range(reach)].to_vec();
            bytes.splice(at..at, part);
        }
        _ => {
            // What is text in it is damaged as text.
            let numbers = tokens(bytes, is_number);
            if !numbers.is_empty() {
                let number = dice.number();
                bytes.splice(numbers[dice.below(numbers.len())].clone(), number.bytes());
            }
        }
    }
}

/// The mutant of this number of a text in TOML: of its lines, numbers and words.
pub fn of_text(text: &str, number: u64) -> String {
    let mut dice = Dice(Stream::new(1, Purpose::Test, number, 1));
    let mut text = text.to_owned();
    // Most do not get past the reader: what does is worth more.
    for _ in 0..=dice.below(2) {
        let bytes = text.as_bytes();
        let kind = dice.below(10);
        match kind {
            0..8 => {
                let numbers = tokens(bytes, is_number);
                let number = dice.number();
                text.replace_range(numbers[dice.below(numbers.len())].clone(), number);
            }
            8 => {
                // One word for another of the same text.
                let words = tokens(bytes, is_word);
                let [from, to] = [dice.below(words.len()), dice.below(words.len())];
                let word = text[words[from].clone()].to_owned();
                text.replace_range(words[to].clone(), &word);
            }
            _ => {
                let mut lines: Vec<&str> = text.lines().collect();
                let [at, to] = [dice.below(lines.len()), dice.below(lines.len())];
                match dice.below(3) {
                    0 => drop(lines.remove(at)),
                    1 => lines.insert(to, lines[at]),
                    _ => lines.swap(at, to),
                }
                text = lines.join("\n");
            }
        }
    }
    text
}

fn is_number(token: &[u8]) -> bool {
    token.iter().any(u8::is_ascii_digit) && matches!(token[0], b'0'..=b'9' | b'-' | b'.')
}

fn is_word(token: &[u8]) -> bool {
    token[0].is_ascii_alphabetic()
}

/// The runs of letters, digits and what numbers are written with that are of a kind.
fn tokens(bytes: &[u8], kind: impl Fn(&[u8]) -> bool) -> Vec<std::ops::Range<usize>> {
    let part = |byte: &u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'+' | b'.' | b'_');
    let mut found = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let length = bytes[at..].iter().take_while(|byte| part(byte)).count();
        if length > 0 && kind(&bytes[at..at + length]) {
            found.push(at..at + length);
        }
        at += length.max(1);
    }
    found
}
