//! Rows of a table in Markdown, and what they say together.

use std::fmt::Write;

use crate::measure::{Found, Method};

/// A number, what others say of it, and what we found.
pub struct Row {
    pub name: String,
    pub exact: f64,
    /// A second witness, and its standard error.
    pub second: Option<(f64, f64)>,
    pub found: Vec<(Method, Found)>,
}

/// More standard errors than this are marked.
const BEYOND: f64 = 3.0;

/// Rows with a column for each method, and what they say together.
pub fn table(rows: &[Row]) -> String {
    let columns: Vec<Method> =
        Method::ALL.into_iter().filter(|m| rows.iter().any(|row| row.found.iter().any(|(n, _)| n == m))).collect();
    let seconds = rows.iter().any(|row| row.second.is_some());
    let mut text = format!("| | theirs |{}", if seconds { " second witness |" } else { "" });
    for method in &columns {
        let _ = write!(text, " {} |", method.name());
    }
    text += &format!("\n|{}\n", "---|".repeat(columns.len() + 2 + usize::from(seconds)));
    for row in rows {
        let _ = write!(text, "| {} | {} |", row.name, digits(row.exact, 5));
        if seconds {
            let _ = match row.second {
                Some((value, error)) if error > 0.0 => write!(text, " {:+.1} σ |", (value - row.exact) / error),
                Some((value, _)) => write!(text, " {:+.0e} |", (value / row.exact - 1.0)),
                None => write!(text, " – |"),
            };
        }
        for method in &columns {
            match row.found.iter().find(|(found, _)| found == method) {
                Some((_, found)) if !found.tells(row.exact) => text += " too noisy |",
                Some((_, found)) => {
                    let sigmas = found.sigmas(row.exact);
                    let bold = if sigmas.abs() > BEYOND { "**" } else { "" };
                    let warned = if found.warned { "†" } else { "" };
                    let share = 100.0 * (found.mean / row.exact - 1.0);
                    let _ = write!(text, " {}{warned} {bold}{sigmas:+.1} σ, {share:+.2} %{bold} |", uncertain(*found));
                }
                None => text += " |",
            }
        }
        text += "\n";
    }
    text + &summary(rows)
}

fn summary(rows: &[Row]) -> String {
    let mut text = String::from(
        "\n| | numbers | mean deviation | χ² for each | beyond 3 σ | farthest |\n|---|---|---|---|---|---|\n",
    );
    for method in Method::ALL {
        let all: Vec<(&Row, Found)> = rows
            .iter()
            .flat_map(|row| {
                row.found
                    .iter()
                    .filter(|(m, found)| *m == method && found.tells(row.exact))
                    .map(move |(_, found)| (row, *found))
            })
            .collect();
        if all.is_empty() {
            continue;
        }
        // Weighted by how sure each is.
        let (mut sum, mut weights) = (0.0, 0.0);
        for (row, found) in &all {
            let weight = (row.exact / found.error.max(1e-4 * row.exact)).powi(2);
            sum += weight * (found.mean / row.exact - 1.0);
            weights += weight;
        }
        let n = all.len() as f64;
        let sigmas = |(row, found): &(&Row, Found)| found.sigmas(row.exact);
        let chi2 = all.iter().map(|cell| sigmas(cell).powi(2)).sum::<f64>() / n;
        let beyond = all.iter().filter(|cell| sigmas(cell).abs() > BEYOND).count();
        let worst = all.iter().max_by(|a, b| sigmas(a).abs().total_cmp(&sigmas(b).abs()));
        let worst = worst.map(|cell| {
            format!("{:+.1} σ, {:+.2} %: {}", sigmas(cell), 100.0 * (cell.1.mean / cell.0.exact - 1.0), cell.0.name)
        });
        let _ = writeln!(
            text,
            "| {} | {} | {:+.3} ± {:.3} % | {chi2:.2} | {beyond} | {} |",
            method.name(),
            all.len(),
            100.0 * sum / weights,
            100.0 / weights.sqrt(),
            worst.unwrap_or_default()
        );
    }
    text
}

/// A mean with its standard error in units of its last digits: 0.26741(12).
fn uncertain(found: Found) -> String {
    let Found { mean, error, .. } = found;
    if error <= 0.0 || mean == 0.0 {
        return digits(mean, 5);
    }
    // Two digits of the error.
    let last = error.log10().floor() as i32 - 1;
    let power = mean.abs().log10().floor() as i32;
    if power < -3 {
        let scaled = mean / 10f64.powi(power);
        let places = (power - last).max(0) as usize;
        return format!("{scaled:.places$}({:.0})e{power}", error / 10f64.powi(last.min(power)));
    }
    let places = (-last).max(0) as usize;
    format!("{mean:.places$}({:.0})", error / 10f64.powi(-(places as i32)))
}

/// So many significant digits.
pub fn digits(x: f64, count: i32) -> String {
    if x == 0.0 {
        return "0".to_string();
    }
    let power = x.abs().log10().floor() as i32;
    if power < -3 {
        return format!("{x:.*e}", (count - 1) as usize);
    }
    format!("{x:.*}", (count - 1 - power).max(0) as usize)
}
