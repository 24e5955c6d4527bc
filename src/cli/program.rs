//! The program: its subcommands, exit codes and messages.

use super::limit::{LimitNotMet, NothingTrusted};
use super::show::{Color, Out};
use super::{
    blind, c2d, check, compare, demo, estimate, excite, export, files, gap, gate, identify, list,
    log, manual, methods, model, response, simulate, simulator, study, watch, words,
};
use clap::{CommandFactory, FromArgMatches, Parser};
use deadtime_signal::text::{message, printed};
use deadtime_signal::threads::at_most;
use std::ffi::OsString;
use std::io::IsTerminal;
use std::path::PathBuf;

/// Dead time and the gap between simulator and machine, from measured logs
///
/// Exit codes: 0 done, 1 a gate or a requested limit was not met, 2 could not run, 3 nothing trusted (estimate --require).
#[derive(Debug, Parser)]
#[command(name = "deadtime", version, about, long_about = None, arg_required_else_help = true, max_term_width = 100)]
#[command(after_help = "Examples:
  deadtime demo
  deadtime estimate flight.csv --input rudder --output yaw_rate
  deadtime gap --model model.toml --log flight.csv --out gap
  deadtime help gap")]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Threads to use, four for each core at most; default: one for each
    #[arg(long, global = true, value_name = "N", hide_short_help = true)]
    threads: Option<usize>,
    /// Also write the answer as JSON; `-` is standard output, and words then go to standard error
    #[arg(long, global = true, value_name = "FILE")]
    json: Option<PathBuf>,
    /// When to colour what is printed
    #[arg(long, global = true, value_enum, value_name = "WHEN", default_value_t = Color::Auto, hide_short_help = true)]
    color: Color,
    /// Print errors only; files are written as ever
    #[arg(short, long, global = true)]
    quiet: bool,
}

#[derive(Debug, clap::Subcommand)]
pub(super) enum Command {
    Demo(demo::Demo),
    Estimate(estimate::Estimate),
    Simulate(simulate::Simulate),
    C2d(c2d::C2d),
    Excite(excite::Excite),
    Check(check::Check),
    Identify(identify::command::Identify),
    Response(response::Response),
    Gap(gap::Gap),
    Export(export::Export),
    Compare(compare::Compare),
    Gate(gate::Gate),
    #[command(subcommand)]
    Blind(blind::Blind),
    List(list::List),
    Log(log::Log),
    Methods(methods::Methods),
    #[command(subcommand)]
    Model(model::Model),
    Study(study::Study),
    Watch(watch::Watch),
    Completions(manual::Completions),
    Man(manual::Man),
}

impl Cli {
    /// Runs the command that was typed.
    ///
    /// # Errors
    /// The error that stopped it, with its file.
    pub fn run(&self, matches: &clap::ArgMatches) -> anyhow::Result<()> {
        let taken = files::apart(&command(), matches)?;
        if let Some(threads) = self.threads {
            let most = at_most(threads);
            if most < threads {
                eprintln!("deadtime: --threads {threads}: {most} are used, four for each core");
            }
            rayon::ThreadPoolBuilder::new().num_threads(most).build_global()?;
        }
        let to = &Out::new(self.json.as_deref(), self.quiet, self.color, taken);
        match &self.command {
            Command::Demo(c) => c.run(to),
            Command::Estimate(c) => c.run(to),
            Command::Simulate(c) => c.run(to),
            Command::C2d(c) => c.run(to),
            Command::Excite(c) => c.run(to),
            Command::Check(c) => c.run(to),
            Command::Identify(c) => c.run(to),
            Command::Response(c) => c.run(to),
            Command::Gap(c) => c.run(to),
            Command::Export(c) => c.run(to),
            Command::Compare(c) => c.run(to),
            Command::Gate(c) => c.run(to),
            Command::Blind(c) => c.run(to),
            Command::List(c) => c.run(to),
            Command::Log(c) => c.run(to),
            Command::Methods(c) => c.run(to),
            Command::Model(c) => c.run(to),
            Command::Study(c) => c.run(to),
            Command::Watch(c) => c.run(to),
            Command::Completions(c) => c.run(to, command()),
            Command::Man(c) => c.run(to, command()),
        }
    }
}

/// Commands by the question that they answer.
const GROUPS: [(&str, &[&str]); 5] = [
    ("answer", &["estimate", "gap", "identify"]),
    ("look", &["check", "log", "response", "simulate", "compare", "watch"]),
    ("trust", &["study", "gate", "blind", "methods"]),
    ("files", &["model", "c2d", "excite", "export"]),
    ("shell", &["demo", "list", "completions", "man"]),
];

/// The first screen: commands by group, and where to begin.
fn first_screen() -> String {
    let mut text =
        "Dead time and the gap between simulator and machine, from measured logs\n\n".to_owned();
    text += "Usage: deadtime COMMAND [OPTIONS]\n";
    for (group, names) in GROUPS {
        text += &format!("  {group:<7} {}\n", names.join(", "));
    }
    text += "Begin:  deadtime demo\n";
    text += "        deadtime estimate LOG.csv --input COMMAND --output RESPONSE\n";
    text += "        deadtime gap --model MODEL.toml --log LOG.csv\n";
    text + "        deadtime COMMAND -h (or --help, every option); deadtime --help lists the commands"
}

/// The definition of the command line, with its first screen.
pub(super) fn command() -> clap::Command {
    let plain = Cli::command();
    let long = plain.clone().render_long_help().to_string();
    let commands = long.find("Commands:").and_then(|from| long.get(from..)).unwrap_or(&long);
    let long = format!("{}\n\n{}", first_screen(), commands.trim_end());
    plain.before_help(first_screen()).before_long_help(long).help_template("{before-help}")
}

/// The exit code of a shell for a program that Ctrl-C ended.
pub(super) const INTERRUPTED: i32 = 130;

/// Ctrl-C and requests to end a program end it at once: half-written files are removed, and the terminal's line is cleared. Where no handler can be set they
/// end it without this cleaning.
pub fn end_when_asked() {
    let _ = ctrlc::set_handler(|| {
        simulator::end_programs();
        deadtime_signal::file::abandon();
        if std::io::stderr().is_terminal() {
            eprintln!("\r\x1b[Kdeadtime: stopped");
        }
        std::process::exit(INTERRUPTED);
    });
}

/// Runs the program with the words that were typed, its own name first; errors go to standard error. The exit code.
pub fn main(words: impl IntoIterator<Item = OsString>) -> u8 {
    let typed = command().try_get_matches_from(words);
    let ran = match typed.and_then(|typed| Ok((Cli::from_arg_matches(&typed)?, typed))) {
        Ok((cli, typed)) => cli.run(&typed),
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
        c.downcast_ref::<std::io::Error>()
            .is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
    };
    match ran {
        Ok(()) => 0,
        // Whoever read our output has seen enough.
        Err(e) if e.chain().any(closed) => 0,
        Err(e) => {
            eprintln!("deadtime: {}", message(&said(&e)));
            match () {
                () if e.is::<LimitNotMet>() => 1,
                () if e.is::<NothingTrusted>() => 3,
                () => 2,
            }
        }
    }
}

/// The error and its causes, each once: some messages already end with their cause.
pub(super) fn said(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(words::worded).filter(|c| !c.is_empty()) {
        if text.is_empty() {
            text = cause;
        } else if !text.ends_with(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The command and all below it.
    fn all(command: &clap::Command, found: &mut Vec<clap::Command>) {
        found.push(command.clone());
        command.get_subcommands().for_each(|c| all(c, found));
    }

    #[test]
    fn every_option_that_writes_svg_refuses_the_name_of_another_kind() {
        let mut commands = Vec::new();
        all(&Cli::command(), &mut commands);
        let writes =
            |a: &&clap::Arg| a.get_help().is_some_and(|help| help.to_string().contains("as SVG"));
        let mut found = 0;
        for command in &commands {
            for option in command.get_arguments().filter(writes).filter_map(clap::Arg::get_long) {
                found += 1;
                for (name, refused) in [
                    ("a.png", true),
                    ("b/c.PDF", true),
                    ("d.jpeg", true),
                    ("e.svg", false),
                    ("f", false),
                ] {
                    let told = Cli::try_parse_from([
                        "deadtime",
                        command.get_name(),
                        &format!("--{option}={name}"),
                    ]);
                    let why = told.err().map(|e| e.to_string()).unwrap_or_default();
                    assert_eq!(
                        why.contains("name it ") && why.contains(".svg"),
                        refused,
                        "{} {name}: {why}",
                        command.get_name()
                    );
                }
            }
        }
        assert!(found >= 2, "{found}");
    }

    #[test]
    fn the_first_screen_has_every_command_once_in_twelve_lines() {
        let grouped: Vec<&str> =
            GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        let mut sorted = grouped.clone();
        sorted.sort_unstable();
        let cli = Cli::command();
        let mut all: Vec<&str> = cli.get_subcommands().map(clap::Command::get_name).collect();
        all.sort_unstable();
        assert_eq!(sorted, all);
        let screen = command().render_help().to_string();
        assert!(screen.trim_end().lines().count() <= 12, "{screen}");
        assert!(screen.lines().all(|l| l.chars().count() <= 90), "{screen}");
    }

    #[test]
    fn a_short_help_fits_on_a_screen_and_keeps_the_rest_for_the_long_one() {
        let mut program = command();
        // Options that all commands share belong to each.
        program.build();
        for one in program.get_subcommands() {
            let mut one = one.clone().term_width(100);
            let short = one.render_help().to_string();
            assert!(short.lines().count() <= 60, "{} lines:\n{short}", short.lines().count());
            let hidden = one.get_arguments().filter(|a| a.is_hide_short_help_set());
            let hidden: Vec<String> =
                hidden.filter_map(|a| Some(format!("--{} ", a.get_long()?))).collect();
            let long = one.render_long_help().to_string() + " ";
            for option in hidden {
                assert!(long.contains(option.trim()), "{option}");
            }
        }
    }

    #[test]
    fn every_help_ends_with_examples_that_are_understood() {
        command().debug_assert();
        let mut commands = Vec::new();
        all(&Cli::command(), &mut commands);
        assert!(commands.len() > 18);
        for command in commands {
            let told = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            let examples: Vec<&str> =
                told.lines().filter_map(|l| l.strip_prefix("  deadtime ")).collect();
            assert!(
                told.starts_with("Examples:\n") && !examples.is_empty(),
                "{} has no examples",
                command.get_name()
            );
            for example in examples {
                // Text between quotes is one word, as in a shell.
                let parts = example.split(" > ").next().unwrap_or_default().split('\'').enumerate();
                let words = parts.flat_map(|(at, part)| {
                    if at % 2 == 1 { vec![part] } else { part.split_whitespace().collect() }
                });
                let parsed = Cli::try_parse_from(std::iter::once("deadtime").chain(words));
                let fine = parsed
                    .as_ref()
                    .map_or_else(|e| e.kind() == clap::error::ErrorKind::DisplayHelp, |_| true);
                assert!(fine, "{example}: {}", parsed.unwrap_err());
            }
        }
    }
}
