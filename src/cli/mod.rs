//! The command line: one file per subcommand.

/// `println!` that hands a closed pipe on as an error instead of panicking.
macro_rules! say {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        anyhow::Context::context(writeln!(std::io::stdout().lock(), $($text)*), "standard output")?
    }};
}

mod c2d;
mod demo;
mod estimate;
mod excite;
mod list;
mod simulate;
mod source;

use clap::Parser;

/// Dead time between command and response, from a measured log
///
/// Exit codes: 0 done, 1 a gate or a requested limit was not met, 2 could not run.
#[derive(Debug, Parser)]
#[command(name = "deadtime", version, about, long_about = None, arg_required_else_help = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Threads to use; default: all
    #[arg(long, global = true, value_name = "N")]
    threads: Option<usize>,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    Demo(demo::Demo),
    Estimate(estimate::Estimate),
    Simulate(simulate::Simulate),
    C2d(c2d::C2d),
    Excite(excite::Excite),
    List(list::List),
}

impl Cli {
    /// Runs the command that was typed.
    ///
    /// # Errors
    /// Whatever stopped it, with the file it is about.
    pub fn run(&self) -> anyhow::Result<()> {
        if let Some(threads) = self.threads {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
        }
        match &self.command {
            Command::Demo(c) => c.run(),
            Command::Estimate(c) => c.run(),
            Command::Simulate(c) => c.run(),
            Command::C2d(c) => c.run(),
            Command::Excite(c) => c.run(),
            Command::List(c) => c.run(),
        }
    }
}
