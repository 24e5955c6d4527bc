//! The command line: one file per subcommand.

/// `println!` that hands a closed pipe on as an error instead of panicking, and shows control characters instead of sending them.
macro_rules! say {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let text = crate::text::printed(&format!($($text)*));
        anyhow::Context::context(writeln!(std::io::stdout().lock(), "{text}"), "standard output")?
    }};
}

mod blind;
mod c2d;
mod check;
mod criteria;
mod demo;
mod estimate;
mod excite;
mod gap;
mod gate;
mod identify;
mod list;
mod log;
mod methods;
mod model;
mod progress;
mod simulate;
mod source;
mod study;
mod words;

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Parser;

use crate::file::write_atomic;
use crate::text::{message, printed};
use crate::threads::at_most;

/// Dead time between command and response, from a measured log
///
/// Exit codes: 0 done, 1 a gate or a requested limit was not met, 2 could not run.
#[derive(Debug, Parser)]
#[command(name = "deadtime", version, about, long_about = None, arg_required_else_help = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Threads to use, four for each core at most; default: one for each
    #[arg(long, global = true, value_name = "N")]
    threads: Option<usize>,
    /// Also write what was found as JSON
    #[arg(long, global = true, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    Demo(demo::Demo),
    Estimate(estimate::Estimate),
    Simulate(simulate::Simulate),
    C2d(c2d::C2d),
    Excite(excite::Excite),
    Check(check::Check),
    Identify(identify::Identify),
    Gap(gap::Gap),
    Gate(gate::Gate),
    #[command(subcommand)]
    Blind(blind::Blind),
    List(list::List),
    Log(log::Log),
    Methods(methods::Methods),
    #[command(subcommand)]
    Model(model::Model),
    Study(study::Study),
}

impl Cli {
    /// Runs the command that was typed.
    ///
    /// # Errors
    /// Whatever stopped it, with the file it is about.
    pub fn run(&self) -> anyhow::Result<()> {
        if let Some(threads) = self.threads {
            let most = at_most(threads);
            if most < threads {
                eprintln!("deadtime: --threads {threads}: {most} are used, four for each core");
            }
            rayon::ThreadPoolBuilder::new().num_threads(most).build_global()?;
        }
        let json = self.json.as_deref();
        match &self.command {
            Command::Demo(c) => c.run(json),
            Command::Estimate(c) => c.run(json),
            Command::Simulate(c) => c.run(json),
            Command::C2d(c) => c.run(json),
            Command::Excite(c) => c.run(json),
            Command::Check(c) => c.run(json),
            Command::Identify(c) => c.run(json),
            Command::Gap(c) => c.run(json),
            Command::Gate(c) => c.run(json),
            Command::Blind(c) => c.run(json),
            Command::List(c) => c.run(json),
            Command::Log(c) => c.run(json),
            Command::Methods(c) => c.run(json),
            Command::Model(c) => c.run(json),
            Command::Study(c) => c.run(json),
        }
    }
}

/// Runs the program with the words that were typed, its own name first; errors go to standard error. The exit code.
pub fn main(words: impl IntoIterator<Item = OsString>) -> u8 {
    let ran = match Cli::try_parse_from(words) {
        Ok(cli) => cli.run(),
        // A wrong word, or a wish for help.
        Err(told) => {
            if told.use_stderr() {
                eprintln!("{}", printed(told.render().to_string().trim_end()));
            } else {
                let _ = told.print();
            }
            return u8::try_from(told.exit_code()).unwrap_or(2);
        }
    };
    let closed = |c: &(dyn std::error::Error + 'static)| {
        c.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
    };
    match ran {
        Ok(()) => 0,
        // Whoever read our output has seen enough.
        Err(e) if e.chain().any(closed) => 0,
        Err(e) => {
            eprintln!("deadtime: {}", message(&words::with_options(&said(&e))));
            if e.is::<LimitNotMet>() { 1 } else { 2 }
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

/// A gate or a requested limit that was not met: exit code 1.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct LimitNotMet(String);

/// Writes `what` as JSON where a file was asked for.
fn write_json(path: Option<&Path>, what: &impl serde::Serialize) -> anyhow::Result<()> {
    let Some(path) = path else { return Ok(()) };
    let text = serde_json::to_string_pretty(what).with_context(|| path.display().to_string())?;
    write_atomic(path, |out| writeln!(out, "{text}"))?;
    Ok(())
}
