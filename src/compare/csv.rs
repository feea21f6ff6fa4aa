//! `results.csv`: a line for each variant, budget and region.

use std::fmt::Write as _;

use super::results::{Figure, Measured, Results};

const COLUMNS: &str = "variant,budget,region,seconds,seconds_se,cpu_seconds,passes,samples,tuned_key,tuned_value,\
mean_r,mean_g,mean_b,mse,mse_se,rmse,rmse_se,relmse,relmse_se,bias2,bias2_se,variance,variance_se";

/// The table. Fields that are not known are empty; of a budget that was not reached, all figures.
pub fn table(results: &Results) -> String {
    let mut text = format!("{COLUMNS}\n");
    for variant in &results.variants {
        for measure in &variant.measures {
            for (index, region) in results.regions.iter().enumerate() {
                let head = [variant.name.clone(), measure.budget.to_string(), quoted(&region.name)];
                let fields = measure.measured.as_ref().map_or_else(
                    || vec![String::new(); COLUMNS.split(',').count() - head.len()],
                    |measured| fields(measured, index),
                );
                let line: Vec<String> = head.into_iter().chain(fields).collect();
                // Writing to a string cannot fail.
                let _ = writeln!(text, "{}", line.join(","));
            }
        }
    }
    text
}

fn fields(measured: &Measured, region: usize) -> Vec<String> {
    let figures = &measured.regions[region];
    let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    let both = |figure: Option<Figure>| [number(figure.map(|f| f.value)), number(figure.and_then(|f| f.error))];
    let setting = measured.tuned.as_ref().map(|tuned| &tuned.setting);
    let mut fields = both(Some(measured.seconds)).to_vec();
    fields.push(number(measured.cpu_seconds.map(|figure| figure.value)));
    fields.extend([measured.passes.to_string(), measured.samples.to_string()]);
    fields.push(setting.map_or(String::new(), |setting| setting.key.clone()));
    fields.push(setting.map_or(String::new(), |setting| quoted(&setting.value)));
    fields.extend(figures.mean.iter().map(|figure| figure.value.to_string()));
    for figure in [Some(figures.mse), Some(figures.rmse), figures.relmse, figures.bias2, figures.variance] {
        fields.extend(both(figure));
    }
    fields
}

/// As RFC 4180 wants it.
pub fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_string() }
}
