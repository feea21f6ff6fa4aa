//! Measurements of which each is a process of its own, so that what it took at most is its own.

use std::process::Command;

pub type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// The numbers that this program prints when it is called with these arguments.
pub fn numbers(arguments: &[&str]) -> Outcome<Vec<f64>> {
    let output = Command::new(std::env::current_exe()?).args(arguments).output()?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into());
    }
    let text = String::from_utf8(output.stdout)?;
    Ok(text.split_whitespace().map(str::parse).collect::<Result<_, _>>()?)
}

/// A pool of one thread.
pub fn one_thread() -> Outcome<rayon::ThreadPool> {
    Ok(rayon::ThreadPoolBuilder::new().num_threads(1).build()?)
}
