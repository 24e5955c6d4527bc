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
            eprintln!("deadtime: {}", said(&e));
            ExitCode::from(if e.is::<deadtime::cli::LimitNotMet>() { 1 } else { 2 })
        }
    }
}

/// The error and its causes, each said once: some messages already end with their cause.
fn said(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string).filter(|c| !c.is_empty()) {
        if text.is_empty() {
            text = cause;
        } else if !text.ends_with(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}
