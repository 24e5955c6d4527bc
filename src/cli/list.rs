//! `deadtime list`: what there is, with options and defaults.

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, bail};
use serde_json::{Value, json};

use super::show::Out;
use crate::report::effects;
use deadtime_delay::{IDENTIFIERS, METHODS, Method};
use deadtime_gap::Criteria;
use deadtime_gap::export::TARGETS;
use deadtime_identify::response::RESPONSES;
use deadtime_log::READERS;
use deadtime_model::ModelDocument;
use deadtime_model::c2d::CONVERSIONS;
use deadtime_model::effect;
use deadtime_model::simulate::System;
use deadtime_model::uav::Dynamics;
use deadtime_signal::EXCITATIONS;
use deadtime_signal::registry::Entry;
use deadtime_study::{PLANS, PLANTS, Plan};

/// List the methods, identification methods, frequency response methods, effects, excitations, conversions, dynamics, plants, plans, readers of log files, targets of an export or thresholds of a diagnosis there are, with their options and
/// defaults
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime list methods
  deadtime list effects --model model.toml")]
pub(super) struct List {
    /// What to list
    #[arg(value_enum)]
    what: What,
    /// With `effects`: every channel of this model on which each can act
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum What {
    Methods,
    Effects,
    Excitations,
    Conversions,
    Dynamics,
    Plants,
    Plans,
    Readers,
    Identifiers,
    Responses,
    /// What `deadtime export` can make of a diagnosis
    Targets,
    /// The thresholds of a diagnosis, of which crates/gap/src/input/criteria.rs tells the meaning and the origin
    Criteria,
}

impl List {
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        if let Some(path) = &self.model {
            if !matches!(self.what, What::Effects) {
                bail!("--model {}: only `list effects` looks at a model", path.display());
            }
            // Where operating points are the log's means, their values do not matter here.
            let system = System::new(&ModelDocument::read(path)?, |_| Ok(0.0))?;
            let menu = effect::menu(&system);
            to.json(&effects::menu_data(&menu))?;
            return print(&effects::menu_text(&system, &menu));
        }
        to.json(&self.entries()?)?;
        let text = match self.what {
            What::Effects => effects::lines_text(&effect::table()),
            What::Methods => METHODS.iter().map(|m| describe(&m.entry)).collect(),
            What::Excitations => EXCITATIONS.iter().map(describe).collect(),
            What::Conversions => CONVERSIONS.iter().map(describe).collect(),
            What::Targets => TARGETS.iter().map(describe).collect(),
            What::Dynamics => Dynamics::ALL
                .map(|d| {
                    let names = |list: &[(&str, &str)]| {
                        list.iter()
                            .map(|(n, u)| format!("{n} [{u}]"))
                            .collect::<Vec<_>>()
                            .join(", ")
                    };
                    format!(
                        "{}\n    states {}; input {}; outputs {}\n",
                        d.name(),
                        names(d.states()),
                        d.input(),
                        names(d.outputs())
                    )
                })
                .concat(),
            What::Plants => {
                PLANTS.iter().map(|p| format!("{}\n    {}\n", p.name, p.summary)).collect()
            }
            What::Identifiers => IDENTIFIERS
                .iter()
                .map(|i| format!("{}    needs {}\n", describe(&i.entry), i.needs))
                .collect(),
            What::Responses => RESPONSES.iter().map(describe).collect(),
            What::Criteria => toml::to_string(&Criteria::default()).context("thresholds")?,
            What::Plans => {
                plans()?.iter().map(|p| format!("{}\n    {}\n", p.name, p.about)).collect()
            }
            What::Readers => READERS
                .iter()
                .map(|r| {
                    format!("{}\n    {}\n    .{}\n", r.name, r.summary, r.extensions.join(", ."))
                })
                .collect(),
        };
        print(&text)
    }
}

fn print(text: &str) -> anyhow::Result<()> {
    std::io::stdout().lock().write_all(text.as_bytes()).context("standard output")
}

impl List {
    fn entries(&self) -> anyhow::Result<Vec<Value>> {
        Ok(match self.what {
            What::Criteria => vec![serde_json::to_value(Criteria::default()).context("thresholds")?],
            What::Methods => METHODS.iter().map(Method::data).collect(),
            What::Effects => effects::lines_data(&effect::table()),
            What::Excitations => EXCITATIONS.iter().map(Entry::data).collect(),
            What::Conversions => CONVERSIONS.iter().map(Entry::data).collect(),
            What::Targets => TARGETS.iter().map(Entry::data).collect(),
            What::Responses => RESPONSES.iter().map(Entry::data).collect(),
            What::Dynamics => Dynamics::ALL
                .iter()
                .map(|d| json!({ "name": d.name(), "states": d.states(), "input": d.input(), "outputs": d.outputs() }))
                .collect(),
            What::Plants => PLANTS.iter().map(|p| json!({ "name": p.name, "summary": p.summary })).collect(),
            What::Identifiers => IDENTIFIERS
                .iter()
                .map(|i| {
                    let mut data = i.entry.data();
                    if let Some(data) = data.as_object_mut() {
                        data.insert("needs".to_owned(), json!(i.needs));
                    }
                    data
                })
                .collect(),
            What::Plans => plans()?.iter().map(|p| json!({ "name": p.name, "summary": p.about })).collect(),
            What::Readers => READERS.iter().map(|r| json!({ "name": r.name, "summary": r.summary, "extensions": r.extensions })).collect(),
        })
    }
}

/// The shipped plans.
fn plans() -> anyhow::Result<Vec<Plan>> {
    PLANS.iter().map(|(name, _)| Ok(Plan::open(name)?)).collect()
}

fn describe<T: ?Sized>(entry: &Entry<T>) -> String {
    format!("{}\n    {}\n    options {}\n", entry.name, entry.summary, (entry.defaults)())
}
