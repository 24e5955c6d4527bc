//! The options that make a program the simulator: `--simulator "COMMAND"` and the names of its channels.

use std::path::Path;
use std::sync::LazyLock;
use std::time::Duration;

use anyhow::{Context, bail};

use super::show::Out;
use super::source::{Needed, Reading, See};
use super::words::pair;
use deadtime_gap::Subject;
use deadtime_log::Log;
use deadtime_model::simulate::process::{Children, Program, Talk};
use deadtime_model::simulate::{Face, Port, Restart, Start, System};
use deadtime_model::{CandidateEntry, ModelDocument};

/// The running programs, for the code that ends this process: they are in separate process groups.
static RUNNING: LazyLock<Children> = LazyLock::new(Children::default);

/// Ends every program that runs as a simulator.
pub(super) fn end_programs() {
    RUNNING.end_all();
}

/// A program as the simulator.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "A program as the simulator")]
pub(super) struct SimulatorArgs {
    /// The program, as the shell reads it: it gets CSV (time and inputs) and answers CSV (outputs), see docs/black-box.md
    #[arg(long, value_name = "COMMAND", requires_all = ["input", "output"])]
    simulator: Option<String>,
    /// An input, as the log calls it; may be repeated
    #[arg(long, value_name = "NAME [UNIT]", requires = "simulator")]
    input: Vec<String>,
    /// An output, as log and program call it; may be repeated
    #[arg(long, value_name = "NAME [UNIT]", requires = "simulator")]
    output: Vec<String>,
    /// A parameter that may be wrong, with its nominal value; may be repeated
    #[arg(long, value_name = "NAME=VALUE [UNIT]", requires = "simulator")]
    parameter: Vec<String>,
    /// A state whose start the program takes, and the standard deviation of that (left out: unknown); may be repeated
    #[arg(
        long,
        value_name = "NAME=VALUE[,STD]",
        requires = "simulator",
        allow_hyphen_values = true,
        hide_short_help = true
    )]
    start: Vec<String>,
    /// The log's channels of the program's states, for a program whose free run diverges, as that of an unstable machine. The program restarts from these
    /// states. STD is the standard deviation of the channel (left out: that of the state's motion)
    #[arg(
        long,
        value_name = "STATE=CHANNEL[:STD],…",
        requires = "simulator",
        value_delimiter = ',',
        hide_short_help = true
    )]
    states: Vec<String>,
    /// Seconds between two starts; default: as long as a perturbation grows tenfold at most
    #[arg(long, value_name = "S", requires = "states", hide_short_help = true)]
    restart_every: Option<f64>,
    /// Start the program once and ask it line by line: `run N`, parameters, a table; it answers with a table
    #[arg(long, requires = "simulator", hide_short_help = true)]
    persistent: bool,
    /// Longest time that one run may take, seconds
    #[arg(
        long,
        value_name = "S",
        default_value_t = 60.0,
        requires = "simulator",
        hide_short_help = true
    )]
    timeout: f64,
}

/// `name [unit]` as its parts.
fn port(text: &str) -> anyhow::Result<Port> {
    let (name, unit) = match text.trim().strip_suffix(']').and_then(|t| t.split_once(" [")) {
        Some((name, unit)) => (name.trim(), Some(unit.trim().to_owned())),
        None => (text.trim(), None),
    };
    if name.is_empty() {
        bail!("a channel without a name: `{text}`");
    }
    Ok(Port { name: name.to_owned(), unit })
}

fn number(option: &str, text: &str, value: &str) -> anyhow::Result<f64> {
    value.trim().parse().with_context(|| format!("--{option} {text}: `{value}` is no number"))
}

/// `name=value [unit]`.
fn parameter(text: &str) -> anyhow::Result<(Port, f64)> {
    let (name, rest) = pair("parameter", text, "NAME=VALUE")?;
    let (value, unit) = match rest.trim().strip_suffix(']').and_then(|t| t.split_once('[')) {
        Some((value, unit)) => (value, Some(unit.trim().to_owned())),
        None => (rest, None),
    };
    Ok((Port { name: name.trim().to_owned(), unit }, number("parameter", text, value)?))
}

/// `name=value,std`.
fn start(text: &str) -> anyhow::Result<Start> {
    let (name, rest) = pair("start", text, "NAME=VALUE,STD")?;
    let (initial, std) =
        rest.split_once(',').map_or((rest, None), |(initial, std)| (initial, Some(std)));
    let std = std.map(|std| number("start", text, std)).transpose()?;
    let port = Port { name: name.trim().to_owned(), unit: None };
    Ok(Start { port, initial: number("start", text, initial)?, std })
}

/// `state=channel:std`: a start that a channel of the log gives.
fn state(text: &str) -> anyhow::Result<(Start, Option<String>)> {
    let (name, channel) = pair("states", text, "STATE=CHANNEL")?;
    // Names of topics may hold a colon; the part behind the last one is a number or belongs to the name.
    let std = channel.rsplit_once(':').map(|(channel, std)| (channel, std.trim().parse::<f64>()));
    let (channel, std) = match std {
        Some((channel, Ok(std))) => (channel, Some(std)),
        _ => (channel, None),
    };
    if channel.trim().is_empty() {
        bail!("--states {text}: write it as STATE=CHANNEL");
    }
    let port = Port { name: name.trim().to_owned(), unit: None };
    Ok((Start { port, initial: 0.0, std }, Some(channel.trim().to_owned())))
}

impl SimulatorArgs {
    fn face(&self, command: &str) -> anyhow::Result<Face> {
        let start = |text: &String| Ok((self::start(text)?, None));
        let mut states = self.start.iter().map(start).collect::<anyhow::Result<Vec<_>>>()?;
        states.extend(self.states.iter().map(|s| state(s)).collect::<anyhow::Result<Vec<_>>>()?);
        let (states, channels) = states.into_iter().unzip();
        if self.restart_every.is_some_and(|s| !(s.is_finite() && s > 0.0)) {
            bail!(
                "--restart-every {}: give seconds above 0",
                self.restart_every.unwrap_or_default()
            );
        }
        let restart =
            (!self.states.is_empty()).then_some(Restart { channels, every_s: self.restart_every });
        Ok(Face {
            name: called(command),
            inputs: self.input.iter().map(|t| port(t)).collect::<Result<_, _>>()?,
            outputs: self.output.iter().map(|t| port(t)).collect::<Result<_, _>>()?,
            states,
            parameters: self.parameter.iter().map(|t| parameter(t)).collect::<Result<_, _>>()?,
            restart,
        })
    }

    fn system(&self, command: &str) -> anyhow::Result<System> {
        if !(self.timeout.is_finite() && self.timeout > 0.0 && self.timeout < 1e9) {
            bail!("--timeout {}: give seconds above 0", self.timeout);
        }
        let face = self.face(command)?;
        let talk = if self.persistent { Talk::Lines } else { Talk::EachRun };
        let program = Program {
            command: command.to_owned(),
            talk,
            timeout: Duration::from_secs_f64(self.timeout),
            folder: None,
        };
        Ok(System::black_box(program.simulator(&face, &RUNNING), face)?)
    }
}

/// A program by its file, one that runs a script by the script.
fn called(command: &str) -> String {
    const RUN_SCRIPTS: [&str; 12] = [
        "bash", "bun", "deno", "env", "julia", "node", "octave", "perl", "python", "rscript",
        "ruby", "sh",
    ];
    let stem = |word: &str| {
        Path::new(word).file_stem().map_or(word.to_owned(), |s| s.to_string_lossy().into_owned())
    };
    let mut words = command.split_whitespace();
    let first = stem(words.next().unwrap_or("simulator"));
    let runs = first.to_lowercase();
    // `python3.12` has the stem `python3`.
    if !RUN_SCRIPTS.contains(&runs.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.')) {
        return first;
    }
    words
        .find(|word| !word.starts_with('-') && Path::new(word).extension().is_some())
        .map_or(first, stem)
}

/// The counterpart of the logs: a model file, or a program.
#[derive(Debug)]
pub(super) enum Simulated {
    Model(Box<ModelDocument>),
    Program(Box<System>),
}

impl Simulated {
    pub(super) fn new(model: Option<&Path>, program: &SimulatorArgs) -> anyhow::Result<Self> {
        match (model, &program.simulator) {
            (Some(path), None) => Ok(Self::Model(Box::new(ModelDocument::read(path)?))),
            (None, Some(command)) => Ok(Self::Program(Box::new(program.system(command)?))),
            _ => bail!("give --model MODEL, or --simulator COMMAND with --input and --output"),
        }
    }

    /// Adds a term that is suspected to be missing.
    pub(super) fn suspect(&mut self, candidate: CandidateEntry) -> anyhow::Result<()> {
        match self {
            Self::Model(document) => Ok(document.suspect(candidate)?),
            Self::Program(_) => {
                bail!("a program's equations cannot be changed: --candidate needs --model")
            }
        }
    }

    /// The records of a log with its channels.
    pub(super) fn read(
        &self,
        to: &Out<'_>,
        reading: &Reading,
        log: &Path,
        required: bool,
        see: See<'_>,
    ) -> anyhow::Result<Vec<Log>> {
        match self {
            Self::Model(document) => reading.read_for(to, log, document, required, see),
            Self::Program(system) => {
                let names =
                    |ports: &[Port]| ports.iter().map(|p| p.name.clone()).collect::<Vec<_>>();
                let mut outputs = names(&system.outputs);
                // The states that it is started from come from the log as well.
                for channel in system.restart.iter().flat_map(|r| r.channels.iter().flatten()) {
                    if !outputs.contains(channel) {
                        outputs.push(channel.clone());
                    }
                }
                reading.read_seeing(
                    to,
                    log,
                    &Needed { inputs: &names(&system.inputs), outputs: &outputs, required },
                    see,
                )
            }
        }
    }
}

impl<'a> From<&'a Simulated> for Subject<'a> {
    fn from(subject: &'a Simulated) -> Self {
        match subject {
            Simulated::Model(document) => document.as_ref().into(),
            Simulated::Program(system) => system.as_ref().into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::called;

    #[test]
    fn a_program_is_called_by_its_file_and_a_script_by_its_own() {
        for (command, name) in [
            ("./pendulum --fast", "pendulum"),
            ("/opt/sim/tank.exe", "tank"),
            ("python3 models/arm.py --gain 2", "arm"),
            ("/usr/bin/python3.12 -u arm.py", "arm"),
            ("env julia tank.jl", "tank"),
            ("python3 -m arm", "python3"),
            ("nodes run.csv", "nodes"),
        ] {
            assert_eq!(called(command), name, "{command}");
        }
    }
}
