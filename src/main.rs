//! The `deadtime` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(deadtime::cli::main(std::env::args_os()))
}
