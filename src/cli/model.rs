//! `deadtime model new`: a commented model file to fill in.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::{Context, bail};

use super::show::Out;
use deadtime_log::{Log, read};
use deadtime_model::ModelDocument;
use deadtime_signal::file::{STANDARD_OUTPUT, write_atomic};

/// Model files
#[derive(Debug, clap::Subcommand)]
#[command(after_help = "Examples:
  deadtime model new linear --out model.toml")]
pub(super) enum Model {
    /// Write a commented template of a model file, with the channel names and units of a log where one is given
    New(New),
}

/// What to write.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime model new linear --out model.toml
  deadtime model new process --log flight.csv --input rudder --output yaw_rate --out model.toml
  deadtime model new quadrotor --log flight.csv --out model.toml")]
pub(super) struct New {
    /// Kind of model
    #[arg(value_enum)]
    kind: Kind,
    /// Log whose channels the model is to have
    #[arg(long, value_name = "LOG")]
    log: Option<PathBuf>,
    /// Input channel (the command); may be repeated; default u
    #[arg(long, value_name = "U")]
    input: Vec<String>,
    /// Output channel (the response); may be repeated; default y
    #[arg(long, value_name = "Y")]
    output: Vec<String>,
    /// The file to write (.toml)
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
}

#[derive(Debug, Clone, Copy, PartialEq, clap::ValueEnum)]
enum Kind {
    /// Matrices A, B, C, D
    Linear,
    /// Gain, time constant and dead time of each pair
    Process,
    /// Differential equations with parameters
    Equations,
    /// Six degrees of freedom under four motor speeds; the log's channels are found by their names
    Quadrotor,
}

impl Model {
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let Self::New(new) = self;
        if new.kind == Kind::Quadrotor {
            return new.quadrotor(to);
        }
        let text = new.text()?;
        new.write(&text)?;
        to.json(&serde_json::json!({ "out": new.out, "inputs": new.names(true), "outputs": new.names(false) }))?;
        say!(
            to,
            "{}: fill in the numbers, then `deadtime simulate` or `deadtime gap` take it",
            new.out.display()
        );
        Ok(())
    }
}

/// The shipped model.
const QUADROTOR: &str = include_str!("../../examples/quadrotor.toml");
/// Its channels, and what logs call them, in small letters and digits alone.
const CHANNELS: [(&str, &[&str]); 17] = [
    ("m1_rads", &["m1", "motor1", "rotor1", "omega1", "motor1rads", "motor1speed", "rpm1rads"]),
    ("m2_rads", &["m2", "motor2", "rotor2", "omega2", "motor2rads", "motor2speed", "rpm2rads"]),
    ("m3_rads", &["m3", "motor3", "rotor3", "omega3", "motor3rads", "motor3speed", "rpm3rads"]),
    ("m4_rads", &["m4", "motor4", "rotor4", "omega4", "motor4rads", "motor4speed", "rpm4rads"]),
    ("x", &["px", "posx", "positionx"]),
    ("y", &["py", "posy", "positiony"]),
    ("z", &["pz", "posz", "positionz"]),
    ("vx", &["velx", "velocityx"]),
    ("vy", &["vely", "velocityy"]),
    ("vz", &["velz", "velocityz"]),
    ("qx", &["quatx", "quaternionx", "orientationx", "attitudex"]),
    ("qy", &["quaty", "quaterniony", "orientationy", "attitudey"]),
    ("qz", &["quatz", "quaternionz", "orientationz", "attitudez"]),
    ("qw", &["quatw", "quaternionw", "orientationw", "attitudew"]),
    ("wx", &["p", "omegax", "ratex", "gyrox", "angularvelocityx"]),
    ("wy", &["q", "omegay", "ratey", "gyroy", "angularvelocityy"]),
    ("wz", &["r", "omegaz", "ratez", "gyroz", "angularvelocityz"]),
];

/// A log's column for a channel: of its own name, else the only one with a known other name. The other name is the whole, or the part after the topic.
fn column(log: &Log, own: &str, also: &[&str]) -> Option<String> {
    if log.names().any(|name| name == own) {
        return Some(own.to_owned());
    }
    let plain = |name: &str| {
        name.chars().filter(|c| c.is_alphanumeric()).collect::<String>().to_lowercase()
    };
    let known = |name: &str| also.contains(&plain(name).as_str()) || plain(name) == plain(own);
    let mut found =
        log.names().filter(|name| known(name) || name.rsplit(['.', '/']).next().is_some_and(known));
    found.next().filter(|_| found.next().is_none()).map(str::to_owned)
}

/// The template with another name for one channel: where channels are listed, grouped and written, and in expressions of a command.
fn renamed(text: &str, own: &str, name: &str) -> String {
    let mut section = "";
    let mut lines = Vec::new();
    for line in text.lines() {
        section = if line.starts_with('[') { line } else { section };
        let of_channel = |line: &str| {
            let line = line
                .replace(&format!("{{ name = \"{own}\""), &format!("{{ name = {}", quoted(name)));
            line.replace(
                &format!("derivative_of = \"{own}\""),
                &format!("derivative_of = {}", quoted(name)),
            )
        };
        lines.push(match section {
            "" => of_channel(line),
            // Commands occur in expressions; their names are no parts of others.
            "[definitions]" if own.ends_with("_rads") => line.replace(own, name),
            "[output_equations]" => match line.strip_prefix(&format!("{own} = ")) {
                Some(rest) => format!("{} = {rest}", quoted(name)),
                None => line.to_owned(),
            },
            "[groups]" => line.replace(&format!("\"{own}\""), &quoted(name)),
            _ => line.to_owned(),
        });
    }
    lines.join("\n") + "\n"
}

/// A text as TOML writes it.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

impl New {
    fn write(&self, text: &str) -> anyhow::Result<()> {
        // The written file must be readable.
        ModelDocument::from_toml(text, &self.out).context(
            "these channel names cannot stand in such a file; rename them (--map when it is used)",
        )?;
        let standard = self.out.as_os_str() == STANDARD_OUTPUT;
        if !standard && self.out.extension().and_then(|e| e.to_str()) != Some("toml") {
            bail!(
                "--out {}: templates carry comments, which only TOML has; name it .toml",
                self.out.display()
            );
        }
        Ok(write_atomic(&self.out, |out| out.write_all(text.as_bytes()))?)
    }

    /// The shipped quadrotor with the log's names where they are known; the states keep theirs.
    fn quadrotor(&self, to: &Out<'_>) -> anyhow::Result<()> {
        if !self.input.is_empty() || !self.output.is_empty() {
            bail!(
                "a quadrotor has its own channels: give --log alone, and --map for what is named otherwise when the model is used"
            );
        }
        let log = self.log.as_deref().map(read).transpose()?;
        let found: Vec<(&str, Option<String>)> = CHANNELS
            .iter()
            .map(|(own, also)| (*own, log.as_ref().and_then(|l| column(l, own, also))))
            .collect();
        let mut text = QUADROTOR.to_owned();
        for (own, name) in &found {
            if let Some(name) = name.as_deref().filter(|name| name != own) {
                text = renamed(&text, own, name);
            }
        }
        let stem = self
            .out
            .file_stem()
            .map_or_else(|| "model".to_owned(), |s| s.to_string_lossy().into_owned());
        let text = text.replacen("name = \"quadrotor\"", &format!("name = {}", quoted(&stem)), 1);
        self.write(&format!(
            "# docs/models.md explains every key. Mass, inertias, arm and coefficients are of one machine: put in your own.\n{text}"
        ))?;
        let missing: Vec<&str> =
            found.iter().filter(|(_, name)| name.is_none()).map(|(own, _)| *own).collect();
        let matched: std::collections::BTreeMap<&str, &String> =
            found.iter().filter_map(|(own, name)| Some((*own, name.as_ref()?))).collect();
        to.json(
            &serde_json::json!({ "out": self.out, "channels": matched, "not_found": missing }),
        )?;
        say!(
            to,
            "{}: put in your machine's mass, inertias, arm and coefficients, then `deadtime check` compares it with a log",
            self.out.display()
        );
        if let Some(log) = &log {
            say!(to, "{} of {} channels are in {}", matched.len(), found.len(), log.source());
            if !missing.is_empty() {
                say!(
                    to,
                    "not found: {}; give their columns by --map NAME=COLUMN when the model is used",
                    missing.join(", ")
                );
            }
        }
        Ok(())
    }

    fn names(&self, input: bool) -> Vec<String> {
        let (given, default) = if input { (&self.input, "u") } else { (&self.output, "y") };
        if given.is_empty() { vec![default.to_owned()] } else { given.clone() }
    }

    fn text(&self) -> anyhow::Result<String> {
        let log = self.log.as_deref().map(read).transpose()?;
        if let Some(log) = &log {
            if self.input.is_empty() || self.output.is_empty() {
                let known: Vec<&str> = log.names().collect();
                bail!(
                    "{}: say which channels are inputs and outputs with --input and --output; there are: {}",
                    log.source(),
                    known.join(", ")
                );
            }
            for name in self.input.iter().chain(&self.output) {
                log.channel(name)?;
            }
        }
        let (inputs, outputs) = (self.names(true), self.names(false));
        let stem = self
            .out
            .file_stem()
            .map_or_else(|| "model".to_owned(), |s| s.to_string_lossy().into_owned());
        let kind = match self.kind {
            Kind::Linear => "lti",
            Kind::Process => "tf",
            Kind::Equations | Kind::Quadrotor => "equations",
        };
        let mut text = format!(
            "# docs/models.md explains every key.\nformat = \"deadtime/model@1\"\nname = {}\nkind = \"{kind}\"\n",
            quoted(&stem)
        );
        if self.kind != Kind::Equations {
            text += "# Seconds between samples; 0: continuous time.\nsample_time_s = 0.0\n";
        }
        text += "# Names are columns of the log; a unit is checked against the log's.\n";
        if self.kind != Kind::Equations {
            text += "# operating = NUMBER or \"mean\": the point that the model is linear about, in the channel's unit; a log's own means are put here.\n";
        }
        for (key, names) in [("inputs ", &inputs), ("outputs", &outputs)] {
            let channels: Vec<String> =
                names.iter().map(|name| self.channel(name, log.as_ref())).collect();
            writeln!(text, "{key} = [{}]", channels.join(", "))?;
        }
        let none = vec!["0.0"; inputs.len()].join(", ");
        writeln!(text, "# Dead time of each input, s.\ninput_delay_s = [{none}]")?;
        match self.kind {
            Kind::Linear => linear(&mut text, inputs.len(), outputs.len())?,
            Kind::Process => process(&mut text, &inputs, &outputs)?,
            Kind::Equations | Kind::Quadrotor => equations(&mut text, &inputs, &outputs)?,
        }
        Ok(text)
    }

    fn channel(&self, name: &str, log: Option<&Log>) -> String {
        let unit = log
            .and_then(|log| log.unit(name))
            .map_or_else(String::new, |unit| format!(", unit = {}", quoted(unit)));
        let operating = match self.kind {
            Kind::Equations | Kind::Quadrotor => String::new(),
            Kind::Linear | Kind::Process => {
                let level = log.and_then(|log| level(log, name)).unwrap_or(0.0);
                format!(", operating = {level:?}")
            }
        };
        format!("{{ name = {}{unit}{operating} }}", quoted(name))
    }
}

/// The mean of a channel to three digits, where it is farther from zero than the standard deviation. Nearer, zero is as likely the point about which the
/// channel moves.
fn level(log: &Log, name: &str) -> Option<f64> {
    let samples = log.channel(name).ok()?.samples();
    let values: Vec<f64> = (0..log.len()).filter_map(|k| samples.get(k)).collect();
    let (mean, moves) = (
        deadtime_signal::stats::mean(values.iter().copied())?,
        deadtime_signal::stats::deviation(&values)?,
    );
    (mean.abs() > moves).then(|| format!("{mean:.2e}").parse().ok()).flatten()
}

fn linear(text: &mut String, inputs: usize, outputs: usize) -> std::fmt::Result {
    let row = |value: &str, n: usize| format!("[{}]", vec![value; n].join(", "));
    writeln!(
        text,
        "# One line per state: dx/dt = A x + B u, y = C x + D u. These numbers are one lag of 1 s."
    )?;
    writeln!(text, "states = [{{ name = \"x1\" }}]")?;
    writeln!(text, "# initial = [0.0]        # state when a log starts")?;
    writeln!(
        text,
        "# initial_std = [0.0]    # how far it is trusted; without it the start is unknown"
    )?;
    writeln!(text, "A = [[-1.0]]\nB = [{}]", row("1.0", inputs))?;
    writeln!(
        text,
        "C = [{}]\nD = [{}]",
        vec!["[1.0]"; outputs].join(", "),
        vec![row("0.0", inputs); outputs].join(", ")
    )
}

fn process(text: &mut String, inputs: &[String], outputs: &[String]) -> std::fmt::Result {
    writeln!(
        text,
        "# One entry per pair: gain/(T s + 1), highest power first; a second order is [T1*T2, T1 + T2, 1.0], an integrator [1.0, 0.0]."
    )?;
    for output in outputs {
        for input in inputs {
            writeln!(text, "[[transfer]]\ninput = {}\noutput = {}", quoted(input), quoted(output))?;
            writeln!(text, "numerator = [1.0]         # gain\ndenominator = [1.0, 1.0]  # T, 1")?;
        }
    }
    Ok(())
}

fn equations(text: &mut String, inputs: &[String], outputs: &[String]) -> std::fmt::Result {
    writeln!(
        text,
        "[states]\n# initial: when a log starts; initial_std: how far it is trusted (without it the start is unknown)."
    )?;
    writeln!(
        text,
        "x1 = {{ initial = 0.0 }}\n[parameters]\ngain = {{ value = 1.0 }}\ntime_constant = {{ value = 1.0, unit = \"s\" }}"
    )?;
    writeln!(
        text,
        "[derivatives]\nx1 = {}\n[output_equations]",
        quoted(&format!("(gain*({}) - x1)/time_constant", inputs.join(" + ")))
    )?;
    outputs.iter().try_for_each(|output| writeln!(text, "{} = \"x1\"", quoted(output)))
}
