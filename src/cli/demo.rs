//! `deadtime demo`: the main job on a simulated flight that ships with the program.

use super::words::option;
use std::path::PathBuf;

use super::estimate::draw;
use super::show::Out;
use super::show::write_json;
use crate::report::diagnosis::{ranking, summary};
use crate::report::folder::{save, save_study};
use crate::report::study::cells;
use crate::report::terminal::delay::short;
use deadtime_delay::{Class, Job, METHODS, Method, Scope};
use deadtime_gap::{GapOptions, diagnose};
use deadtime_log as log;
use deadtime_model::{ModelDocument, ModelFile};
use deadtime_signal::file::write_atomic;
use deadtime_signal::stop::Stop;
use deadtime_study::{Plan, Runner};

/// Run the main job on a simulated UAV flight that ships with the program
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime demo
  deadtime demo --out first-look")]
pub(super) struct Demo {
    /// Folder to write to
    #[arg(long, value_name = "DIR", default_value = "deadtime-demo")]
    out: PathBuf,
    /// Seed of the accuracy study
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// Thirty seconds of the thesis' lateral dynamics under a stabilising feedback, random binary reference, noise at a ratio of variances of 100.
const FLIGHT: &str = include_str!("../../examples/uav_flight.csv");
const MODEL: &str = include_str!("../../examples/uav_lateral_stabilised.toml");
/// The dead time that the flight was simulated with, s.
const TRUTH_S: f64 = 0.13;
/// What the accuracy study is of; the model file stands in the folder that is written to.
const PLAN: &str = include_str!("../../crates/study/src/plans/demo.toml");
/// Records per injected delay in the accuracy study.
const TRIALS: usize = 40;

impl Demo {
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let file = |name: &str| self.out.join(name);
        for (name, text) in [("uav_flight.csv", FLIGHT), ("uav_lateral_stabilised.toml", MODEL)] {
            write_atomic(&file(name), |out| out.write_all(text.as_bytes()))?;
        }
        self.dead_time(to)?;
        self.accuracy(to)?;
        self.gap(to)?;
        say!(
            to,
            "\nWritten to {}: uav_flight.csv and uav_lateral_stabilised.toml (what went in), estimate.json,\nestimate.svg (the picture), accuracy/ (the study), diagnosis.json, report.html, model_with_effects.toml.",
            self.out.display()
        );
        say!(
            to,
            "Next, your own log:  deadtime estimate LOG.csv --input COMMAND --output RESPONSE"
        );
        say!(to, "     and simulator:  deadtime gap --model MODEL.toml --log LOG.csv --out DIR");
        Ok(())
    }

    fn dead_time(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let model = ModelFile::read(&self.out.join("uav_lateral_stabilised.toml"))?;
        say!(
            to,
            "1. How long is the dead time? A simulated UAV flies on a random binary roll command r; roll rate p, side acceleration ay and"
        );
        say!(
            to,
            "   the states were logged, with noise. The command reached the vehicle late: by {TRUTH_S} s, which the methods are not told.\n"
        );
        let logs = vec![log::csv::read_from("uav_flight.csv", FLIGHT.as_bytes())?];
        let job = Job { model: Some(model.clone()), ..Job::new(logs, ["r"], ["p", "ay"]) };
        let report = job.run()?.worded(option);
        to.styled(&short(&report))?;
        write_json(&self.out.join("estimate.json"), &report)?;
        draw(&job, &report, &self.out.join("estimate.svg"))?;
        to.json(&report)?;
        say!(
            to,
            "\n   The truth is {TRUTH_S} s, six samples and a half. Methods that count samples can only come to within one; the one that knows the"
        );
        say!(
            to,
            "   dynamics and sees the states resolves the half sample. Their intervals say so."
        );
        Ok(())
    }

    fn accuracy(&self, to: &Out<'_>) -> anyhow::Result<()> {
        say!(
            to,
            "\n2. Which method may be trusted to say so? The same vehicle again, {TRIALS} records for each of four delays that are injected and"
        );
        say!(
            to,
            "   so are known; output p, 600 samples, the same noise; of each class of methods the one that is trusted most.\n"
        );
        let mut plan = Plan::parse("demo", PLAN, &self.out)?;
        plan.seed = self.seed;
        plan.grids.iter_mut().for_each(|g| {
            g.trials = TRIALS;
            g.method = most_trusted().map(|m| m.entry.name.to_owned()).collect();
        });
        let folder = self.out.join("accuracy");
        let study = Runner::new(&plan)?.run(&folder, true, &Stop::default(), &|_| ())?;
        let (_, accuracy) = cells(&study, &plan.name);
        say!(to, "{}", accuracy.to_string().trim_end_matches('\n'));
        save_study(&study, &plan, &folder)?;
        say!(
            to,
            "\n   Errors are in samples of 0.02 s, over the records that got an answer. A method to trust has a small error, and"
        );
        say!(to, "   an interval that holds the truth about as often as it promises.");
        Ok(())
    }

    fn gap(&self, to: &Out<'_>) -> anyhow::Result<()> {
        say!(
            to,
            "\n3. Where do simulator and machine differ? The same simulator, which knows of no delay, against the same flight: every effect of the"
        );
        say!(to, "   catalogue on every channel, the last 30 % of the flight held back.\n");
        let logs = [log::csv::read_from("uav_flight.csv", FLIGHT.as_bytes())?];
        let document = ModelDocument::read(&self.out.join("uav_lateral_stabilised.toml"))?;
        let found = diagnose(
            &document,
            &logs,
            &[],
            &GapOptions { seed: self.seed, ..GapOptions::default() },
            &|_| (),
        )?
        .worded(option);
        for line in summary(&found).lines() {
            say!(to, "   {line}");
        }
        say!(to, "\n{}", ranking(&found.diagnosis, 6).to_string().trim_end());
        save(&found, &self.out)?;
        Ok(())
    }
}

/// The most trusted method of every class that looks at commands and responses.
fn most_trusted() -> impl Iterator<Item = &'static Method> {
    Class::ALL
        .iter()
        .filter_map(|class| METHODS.iter().find(|m| m.class == *class && m.scope != Scope::Events))
}
