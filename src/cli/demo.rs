//! `deadtime demo`: the main job on a simulated flight that ships with the program.

use super::words::option;
use std::path::PathBuf;

use super::estimate::draw;
use super::progress::Bar;
use super::show::Out;
use super::show::write_json;
use crate::report::folder::{save, save_study};
use crate::report::study::overview;
use crate::report::terminal::delay::brief;
use crate::report::terminal::short_diagnosis;
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
/// The plan of the accuracy study; the model file is in the output folder.
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
            "\nWritten to {}: the flight, its model, estimate.json, estimate.svg, accuracy/, report.html (the page).",
            self.out.display()
        );
        say!(to, "Your log:   deadtime estimate LOG.csv --input COMMAND --output RESPONSE");
        say!(to, "Your model: deadtime gap --model MODEL.toml --log LOG.csv");
        Ok(())
    }

    fn dead_time(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let model = ModelFile::read(&self.out.join("uav_lateral_stabilised.toml"))?;
        say!(
            to,
            "1. Dead time of a simulated UAV flight, from the roll command `r` (true value {TRUTH_S} s)\n"
        );
        let logs = vec![log::csv::read_from("uav_flight.csv", FLIGHT.as_bytes())?];
        let job = Job { model: Some(model.clone()), ..Job::new(logs, ["r"], ["p", "ay"]) };
        let report = job.run()?.worded(option);
        to.styled(&brief(&report))?;
        write_json(&self.out.join("estimate.json"), &report)?;
        draw(&job, &report, &self.out.join("estimate.svg"))?;
        to.json(&report)?;
        say!(
            to,
            "\nMethods that count samples of 0.02 s cannot resolve half a sample. The third answer"
        );
        say!(to, "uses the model and the logged states, and resolves it.");
        Ok(())
    }

    fn accuracy(&self, to: &Out<'_>) -> anyhow::Result<()> {
        say!(
            to,
            "\n2. Accuracy of one method of each class: {TRIALS} records for each of four injected dead times\n"
        );
        let mut plan = Plan::parse("demo", PLAN, &self.out)?;
        plan.seed = self.seed;
        plan.grids.iter_mut().for_each(|g| {
            g.trials = TRIALS;
            g.method = most_trusted().map(|m| m.entry.name.to_owned()).collect();
        });
        let folder = self.out.join("accuracy");
        let bar = Bar::new(to);
        let study = Runner::new(&plan)?.run(&folder, true, &Stop::default(), &|_| ())?;
        drop(bar);
        say!(to, "{}", overview(&study, BEST).to_string().trim_end_matches('\n'));
        Ok(save_study(&study, &plan, &folder)?)
    }

    fn gap(&self, to: &Out<'_>) -> anyhow::Result<()> {
        say!(
            to,
            "\n3. Gap between the same flight and a simulator without dead time; the last 30 % are held out\n"
        );
        let logs = [log::csv::read_from("uav_flight.csv", FLIGHT.as_bytes())?];
        let document = ModelDocument::read(&self.out.join("uav_lateral_stabilised.toml"))?;
        let options = GapOptions { seed: self.seed, ..GapOptions::default() };
        let bar = Bar::new(to);
        let found = diagnose(&document, &logs, &[], &options, &|stage| {
            bar.far().at(stage.begins_at(), &stage)
        });
        drop(bar);
        let found = found?.worded(option);
        to.styled(&short_diagnosis(&found))?;
        save(&found, &self.out)?;
        Ok(())
    }
}

/// Methods of the study that are shown.
const BEST: usize = 4;

/// The most trusted method of every class of methods for commands and responses.
fn most_trusted() -> impl Iterator<Item = &'static Method> {
    Class::ALL
        .iter()
        .filter_map(|class| METHODS.iter().find(|m| m.class == *class && m.scope != Scope::Events))
}
