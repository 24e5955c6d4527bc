//! `deadtime study`: how accurate methods are, on delays that were injected.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::bail;

use super::progress::Bar;
use super::show::Out;
use crate::report::bounds;
use crate::report::folder::save_study;
use crate::report::study::{full, text};
use deadtime_signal::file::{component, write_atomic};
use deadtime_signal::stop::Stop;
use deadtime_signal::text::message;
use deadtime_study::{Budget, Plan, Progress, Runner};

/// Study how accurate methods are, on delays that were injected and so are known
///
/// A run that was stopped goes on where it was with --resume.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime study
  deadtime study plan.toml --out mine
  deadtime study plan.toml --out mine --resume")]
pub(super) struct Study {
    /// A shipped plan (`deadtime list plans`) or a plan file
    #[arg(value_name = "PLAN", default_value = "thesis")]
    plan: String,
    /// Folder for study.json, estimates.csv, tables.md and report.html, the page; default study-PLAN
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Only this grid of the plan (again for further ones)
    #[arg(long, value_name = "NAME")]
    grid: Vec<String>,
    /// Only this method of the plan (again for further ones)
    #[arg(long, value_name = "NAME")]
    method: Vec<String>,
    /// Records of each setting; default: as the plan says
    #[arg(long, value_name = "N")]
    trials: Option<usize>,
    /// Seed; default: as the plan says
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Go on where an earlier run of this plan was stopped; parts that are damaged are made again
    #[arg(long)]
    resume: bool,
    /// Memory that the study may need, GB; it is estimated before anything is made
    #[arg(long, value_name = "GB", default_value_t = Budget::default().memory_gb)]
    max_memory_gb: f64,
    /// Room on the disk that the study may need, GB
    #[arg(long, value_name = "GB", default_value_t = Budget::default().disk_gb)]
    max_disk_gb: f64,
    /// Also write a picture of errors and the Cramér-Rao bound, for grids that lay out `over_bound: snr` or `over_bound: samples`, as SVG
    #[arg(long, alias = "plot", value_name = "FILE", value_parser = super::picture::picture())]
    svg: Option<PathBuf>,
    /// Every column of every table, as wide as it comes
    #[arg(long)]
    full: bool,
}

impl Study {
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let mut plan = Plan::open(&self.plan)?;
        plan.only(&self.grid, &self.method)?;
        if let Some(trials) = self.trials {
            if trials == 0 {
                bail!("--trials 0: give at least 1");
            }
            plan.grids.iter_mut().for_each(|g| g.trials = trials);
        }
        plan.seed = self.seed.unwrap_or(plan.seed);
        let folder = self
            .out
            .clone()
            .unwrap_or_else(|| PathBuf::from(component(&format!("study-{}", plan.name))));
        let runner = Runner::within(
            &plan,
            &Budget { memory_gb: self.max_memory_gb, disk_gb: self.max_disk_gb },
        )?;
        let stop = Stop::default();
        let begun = runner.begin(&folder, self.resume, &stop)?;
        for damaged in begun.damaged() {
            eprintln!("{}", message(&damaged.to_string()));
        }
        let bar = Bar::new(to);
        let clock = Instant::now();
        let study = begun.run(&stop, &|p| bar.far().at(share(p), &left(p, clock)));
        drop(bar);
        let study = study?;
        to.json(&study)?;
        save_study(&study, &plan, &folder)?;
        if let Some(path) = &self.svg {
            let drawing = bounds::svg(&study, &plan);
            let drawing = drawing.ok_or_else(|| {
                anyhow::anyhow!(
                    "--svg: no grid of {} lays out `over_bound: snr` or `over_bound: samples`",
                    plan.name
                )
            })?;
            write_atomic(path, |out| out.write_all(drawing.as_bytes()))?;
        }
        let told = if self.full { full(&study, Some(&plan)) } else { text(&study, Some(&plan)) };
        say!(to, "{}", told.trim_end());
        say!(
            to,
            "\n{} estimates. Written to {}: study.json, estimates.csv, tables.md, report.html.",
            runner.estimates(),
            folder.display()
        );
        Ok(())
    }
}

fn share(p: Progress) -> f64 {
    p.done as f64 / p.all.max(1) as f64
}

/// Estimates made, and the time that the rest will take at the pace so far.
fn left(p: Progress, clock: Instant) -> String {
    let left_s = clock.elapsed().as_secs_f64() / p.now.max(1) as f64 * (p.all - p.done) as f64;
    let time = match left_s {
        _ if p.now == 0 => "…".to_owned(),
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    };
    format!("{} of {} estimates, {time} left", p.done, p.all)
}
