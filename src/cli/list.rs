//! `deadtime list`: what there is, with options and defaults.

use std::io::Write;

use anyhow::Context;

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
    pub(super) fn run(&self) -> anyhow::Result<()> {
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

fn describe<T: ?Sized>(entry: &Entry<T>) -> String {
    format!("{}\n    {}\n    options {}\n", entry.name, entry.summary, (entry.defaults)())
}
