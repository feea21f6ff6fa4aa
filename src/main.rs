use std::process::ExitCode;

fn main() -> ExitCode {
    volpm::cli::main(std::env::args_os())
}
