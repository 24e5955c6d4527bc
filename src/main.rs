//! The `deadtime` program.

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    match deadtime::cli::Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        // Whoever read our output has seen enough.
        Err(e) if e.chain().any(|c| c.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)) => {
            ExitCode::SUCCESS
        }
        Err(e) => {
            eprintln!("deadtime: {e:#}");
            ExitCode::from(if e.is::<deadtime::cli::LimitNotMet>() { 1 } else { 2 })
        }
    }
}
