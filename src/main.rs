//! The `deadtime` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    deadtime::cli::end_when_asked();
    ExitCode::from(deadtime::cli::main(std::env::args_os()))
}
