//! Published values, for comparison with the results of a study.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::keys::{Loop, Place};
use super::results::{Cell, Study};
use deadtime_signal::stats;

/// A published number and the cells that it is of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// The table or figure.
    pub source: String,
    /// The cells; where there are several, the mean over them.
    pub cells: Which,
    /// The published statistic.
    pub statistic: Statistic,
    /// With `rms_samples`: the share of answers that was kept, percent; default 100.
    #[serde(default = "whole")]
    pub kept_percent: f64,
    /// The number; absent for `failed`, and where none was printed.
    #[serde(default)]
    pub value: Option<f64>,
    /// The largest difference of a match, in its unit; default half a unit of its last digit.
    #[serde(default)]
    pub tolerance: Option<f64>,
    /// Why it cannot come out but by chance, where that is known.
    #[serde(default)]
    pub not_reproducible: Option<String>,
}

pub(super) fn whole() -> f64 {
    100.0
}

/// The published statistic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Statistic {
    /// Root mean square error, samples.
    RmsSamples,
    /// Mean of the raw answers, s.
    MeanRawS,
    /// Standard deviation of the raw answers, s.
    StdRawS,
    /// That the method failed every time.
    Failed,
}

/// Keys of cells; an omitted key matches every cell.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Which {
    pub grid: Option<String>,
    pub plant: Option<String>,
    pub output: Option<String>,
    pub c2d: Option<String>,
    pub excitation: Option<String>,
    pub snr: Option<f64>,
    #[serde(rename = "loop")]
    pub loops: Option<Loop>,
    pub place: Option<Place>,
    /// The method with its options.
    pub method: Option<String>,
}

/// The agreement of a result with a published value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Standing {
    /// Within the tolerance.
    Matching,
    /// Outside.
    Differing,
    /// It is known not to come out but by chance.
    NotReproducible,
}

/// A published number with ours.
#[derive(Debug, Clone, PartialEq)]
pub struct Beside<'a> {
    /// The published one.
    pub published: &'a Published,
    /// Ours; with `failed`, the share of records without an answer.
    pub ours: Option<f64>,
    /// The comparison.
    pub standing: Standing,
}

impl Which {
    /// The cell is one of them.
    #[must_use]
    pub fn holds(&self, cell: &Cell) -> bool {
        let is = |wanted: &Option<String>, got: &str| wanted.as_deref().is_none_or(|w| w == got);
        is(&self.grid, &cell.grid)
            && is(&self.plant, &cell.plant)
            && is(&self.output, &cell.output)
            && is(&self.c2d, &cell.c2d)
            && is(&self.excitation, &cell.excitation)
            && self.snr.is_none_or(|s| cell.snr == Some(s))
            && self.loops.is_none_or(|l| l == cell.loops)
            && self.place.is_none_or(|p| p == cell.place)
            && self.method.as_deref().is_none_or(|m| words(m) == words(&cell.method_text()))
    }
}

impl std::fmt::Display for Which {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { grid, plant, output, c2d, excitation, snr, loops, place, method } = self;
        let words = [
            method.clone(),
            plant.clone(),
            output.clone(),
            c2d.clone(),
            excitation.clone(),
            snr.map(|s| format!("SNR {s}")),
        ];
        let more = [
            grid.clone(),
            loops.map(|l| l.name().to_owned()),
            place.map(|p| format!("from {}", p.name())),
        ];
        f.write_str(&words.into_iter().chain(more).flatten().collect::<Vec<_>>().join(", "))
    }
}

/// A method and its options, in any order.
fn words(text: &str) -> BTreeSet<&str> {
    text.split_whitespace().collect()
}

/// Keys of an entry itself; every other key in a table of `each` is a key of its cells.
const OWN: [&str; 6] =
    ["source", "statistic", "kept_percent", "value", "tolerance", "not_reproducible"];

/// An entry with a list `each` of tables is expanded to one entry per table. The table's keys replace its own or those of its cells.
pub(super) fn spread(entries: toml::Value) -> Result<toml::Value, String> {
    let toml::Value::Array(entries) = entries else {
        return Err("`published` is a list of tables: write [[published]]".to_owned());
    };
    let mut all = Vec::with_capacity(entries.len());
    for entry in entries {
        let toml::Value::Table(mut shared) = entry else {
            return Err("`published` holds tables: write [[published]]".to_owned());
        };
        let Some(each) = shared.remove("each") else {
            all.push(toml::Value::Table(shared));
            continue;
        };
        let toml::Value::Array(each) = each else {
            return Err("published.each is a list of tables".to_owned());
        };
        for one in each {
            let toml::Value::Table(one) = one else {
                return Err("published.each is a list of tables".to_owned());
            };
            let (own, of_cells): (toml::Table, toml::Table) =
                one.into_iter().partition(|(key, _)| OWN.contains(&key.as_str()));
            let mut entry = shared.clone();
            entry.extend(own);
            if let toml::Value::Table(cells) =
                entry.entry("cells").or_insert_with(|| toml::Table::new().into())
            {
                cells.extend(of_cells);
            }
            all.push(toml::Value::Table(entry));
        }
    }
    Ok(toml::Value::Array(all))
}

impl Published {
    /// The published value with a study's result; `None` where the study has none of its cells.
    #[must_use]
    pub fn beside(&self, study: &Study) -> Option<Beside<'_>> {
        let cells: Vec<&Cell> = study.cells.iter().filter(|c| self.cells.holds(c)).collect();
        if cells.is_empty() {
            return None;
        }
        let mean =
            |of: &dyn Fn(&Cell) -> Option<f64>| stats::mean(cells.iter().filter_map(|c| of(c)));
        let ours = match self.statistic {
            Statistic::RmsSamples => {
                mean(&|c| c.kept.iter().find(|k| k.percent == self.kept_percent)?.rms_samples)
            }
            Statistic::MeanRawS => mean(&|c| c.mean_raw_s),
            Statistic::StdRawS => mean(&|c| c.std_raw_s),
            Statistic::Failed => mean(&|c| Some(c.flagged as f64 / c.trials.max(1) as f64)),
        };
        let wanted = if self.statistic == Statistic::Failed { Some(1.0) } else { self.value };
        let near = ours
            .zip(wanted)
            .is_some_and(|(a, b)| (a - b).abs() <= self.tolerance.unwrap_or(NEAR * b.abs()));
        let standing = match (near, &self.not_reproducible) {
            // That chance comes near is no reproduction.
            (_, Some(_)) => Standing::NotReproducible,
            (true, None) => Standing::Matching,
            (false, None) => Standing::Differing,
        };
        Some(Beside { published: self, ours, standing })
    }
}

/// Without a tolerance, a published number of two digits is met within this share.
const NEAR: f64 = 0.05;
