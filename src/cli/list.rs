//! `deadtime list`: what there is, with options and defaults.

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
            return to.listing(&effects::menu_text(&system, &menu));
        }
        let entries = self.entries()?;
        to.json(&entries)?;
        to.listing(&match self.what {
            What::Effects => effects::lines_text(&effect::table()),
            What::Criteria => toml::to_string(&Criteria::default()).context("thresholds")?,
            What::Dynamics => Dynamics::ALL.map(dynamics).concat(),
            What::Identifiers => entries
                .iter()
                .map(|e| described(e) + &format!("    needs {}\n", word(e, "needs")))
                .collect(),
            What::Readers => READERS
                .iter()
                .zip(&entries)
                .map(|(r, e)| described(e) + &format!("    .{}\n", r.extensions.join(", .")))
                .collect(),
            _ => entries.iter().map(described).collect(),
        })
    }

    /// The entries, as data.
    fn entries(&self) -> anyhow::Result<Vec<Value>> {
        let brief = |name: &str, summary: &str| json!({ "name": name, "summary": summary });
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
            What::Plants => PLANTS.iter().map(|p| brief(p.name, p.summary)).collect(),
            What::Identifiers => {
                let with_needs = |mut data: Value, needs: &str| {
                    if let Some(data) = data.as_object_mut() {
                        data.insert("needs".to_owned(), json!(needs));
                    }
                    data
                };
                IDENTIFIERS.iter().map(|i| with_needs(i.entry.data(), i.needs)).collect()
            }
            What::Plans => plans()?.iter().map(|p| brief(&p.name, &p.about)).collect(),
            What::Readers => READERS
                .iter()
                .map(|r| json!({ "name": r.name, "summary": r.summary, "extensions": r.extensions }))
                .collect(),
        })
    }
}

/// The shipped plans.
fn plans() -> anyhow::Result<Vec<Plan>> {
    PLANS.iter().map(|(name, _)| Ok(Plan::open(name)?)).collect()
}

fn word<'a>(entry: &'a Value, key: &str) -> &'a str {
    entry.get(key).and_then(Value::as_str).unwrap_or_default()
}

/// Name, summary and options.
fn described(entry: &Value) -> String {
    let options = entry.get("options").map(|o| format!("    options {o}\n"));
    format!(
        "{}\n    {}\n{}",
        word(entry, "name"),
        word(entry, "summary"),
        options.unwrap_or_default()
    )
}

fn dynamics(d: Dynamics) -> String {
    let names = |list: &[(&str, &str)]| {
        list.iter().map(|(n, u)| format!("{n} [{u}]")).collect::<Vec<_>>().join(", ")
    };
    let (states, outputs) = (names(d.states()), names(d.outputs()));
    format!("{}\n    states {states}; input {}; outputs {outputs}\n", d.name(), d.input())
}
