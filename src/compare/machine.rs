//! What the system tells of the machine and of this process.

use std::fs;

use super::results::{Machine, Program};

/// This program.
pub fn program() -> Program {
    Program {
        name: env!("CARGO_PKG_NAME").to_string(),
        version: env!("CARGO_PKG_VERSION").to_string(),
        commit: option_env!("VOLPM_COMMIT").map(str::to_string),
    }
}

/// This machine.
pub fn machine() -> Machine {
    let cpus = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = cpus.lines().find_map(|line| line.strip_prefix("model name"));
    Machine {
        cpu: name.map(|name| name.trim_start_matches([' ', '\t', ':']).trim().to_string()),
        logical_cores: std::thread::available_parallelism().map_or(1, usize::from),
        os: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
    }
}

/// The most memory the process has held since it started, or since `forget_peak`, in bytes.
pub fn peak_bytes() -> Option<u64> {
    status_bytes("VmHWM:")
}

/// The memory that the process holds, in bytes.
pub fn resident_bytes() -> Option<u64> {
    status_bytes("VmRSS:")
}

fn status_bytes(name: &str) -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

/// Makes [`peak_bytes`] count from now on. Returns whether it does.
pub fn forget_peak() -> bool {
    // See proc_pid_clear_refs(5).
    fs::write("/proc/self/clear_refs", "5").is_ok()
}

/// Seconds that all threads of the process have computed, to a hundredth; `None` where the system does not tell that.
pub fn cpu_seconds() -> Option<f64> {
    let stat = fs::read_to_string("/proc/self/stat").ok()?;
    // The name in parentheses may hold anything; user and system time are fields 14 and 15, in ticks of 10 ms.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_ascii_whitespace().collect();
    let ticks = |field: usize| fields.get(field - 3)?.parse::<u64>().ok();
    Some((ticks(14)? + ticks(15)?) as f64 * 0.01)
}

/// A number that differs between builds of the program.
pub fn build() -> u128 {
    let program = std::env::current_exe().and_then(fs::read).unwrap_or_default();
    xxhash_rust::xxh3::xxh3_128(&program)
}
