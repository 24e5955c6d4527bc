//! `deadtime list`: what there is, with options and defaults.

use std::io::Write;
use std::path::Path;

use anyhow::Context;
use serde_json::{Value, json};

use super::write_json;
use crate::delay::METHODS;
use crate::model::c2d::CONVERSIONS;
use crate::model::uav::Dynamics;
use crate::registry::Entry;
use crate::signal::EXCITATIONS;

/// List the methods, excitations, conversions or dynamics there are, with their options and defaults
#[derive(Debug, clap::Args)]
pub(super) struct List {
    /// What to list
    #[arg(value_enum)]
    what: What,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum What {
    Methods,
    Excitations,
    Conversions,
    Dynamics,
}

impl List {
    pub(super) fn run(&self, json: Option<&Path>) -> anyhow::Result<()> {
        write_json(json, &self.entries())?;
        let text = match self.what {
            What::Methods => METHODS.iter().map(|m| describe(&m.entry)).collect(),
            What::Excitations => EXCITATIONS.iter().map(describe).collect(),
            What::Conversions => CONVERSIONS.iter().map(describe).collect(),
            What::Dynamics => Dynamics::ALL
                .map(|d| {
                    let names = |list: &[(&str, &str)]| list.iter().map(|(n, u)| format!("{n} [{u}]")).collect::<Vec<_>>().join(", ");
                    format!("{}\n    states {}; input {}; outputs {}\n", d.name(), names(d.states()), d.input(), names(d.outputs()))
                })
                .concat(),
        };
        std::io::stdout().lock().write_all(String::as_bytes(&text)).context("standard output")
    }
}

impl List {
    fn entries(&self) -> Vec<Value> {
        match self.what {
            What::Methods => METHODS.iter().map(|m| fields(&m.entry)).collect(),
            What::Excitations => EXCITATIONS.iter().map(fields).collect(),
            What::Conversions => CONVERSIONS.iter().map(fields).collect(),
            What::Dynamics => Dynamics::ALL
                .iter()
                .map(|d| json!({ "name": d.name(), "states": d.states(), "input": d.input(), "outputs": d.outputs() }))
                .collect(),
        }
    }
}

fn fields<T: ?Sized>(entry: &Entry<T>) -> Value {
    json!({ "name": entry.name, "summary": entry.summary, "options": (entry.defaults)() })
}

fn describe<T: ?Sized>(entry: &Entry<T>) -> String {
    format!("{}\n    {}\n    options {}\n", entry.name, entry.summary, (entry.defaults)())
}
