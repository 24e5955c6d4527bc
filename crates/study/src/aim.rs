//! The target values of a plan, for comparison with its results.

use serde::{Deserialize, Serialize};

use super::published::Which;
use super::results::{Cell, Study};
use deadtime_signal::stats;

/// A number to be reached.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Aim {
    /// The aim, in words.
    pub aim: String,
    /// The cells.
    pub cells: Which,
    /// The methods, as the plan writes them.
    pub method: Vec<String>,
    /// The best of the methods is to reach it, rather than each.
    #[serde(default)]
    pub best: bool,
    /// The measure.
    pub measure: Measure,
    /// With `rms_samples`: the share of answers that is kept, percent; default 100.
    #[serde(default = "super::published::whole")]
    pub kept_percent: f64,
    /// Every cell is to reach it, rather than their mean.
    #[serde(default)]
    pub each: bool,
    /// Upper limit.
    #[serde(default)]
    pub at_most: Option<f64>,
    /// Lower limit.
    #[serde(default)]
    pub at_least: Option<f64>,
}

/// The statistic of an aim.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Measure {
    /// Root mean square error, samples.
    RmsSamples,
    /// The same over the bound.
    RmsOverBound,
    /// Share of records without an answer.
    Flagged,
    /// Share of intervals that hold the truth.
    Coverage95,
}

/// How an aim was met.
#[derive(Debug, Clone, PartialEq)]
pub struct Reached<'a> {
    /// The method.
    pub method: &'a str,
    /// The mean over the cells; with `each`, the value of the cell that is furthest off.
    pub value: f64,
    /// That cell.
    pub cell: Option<&'a Cell>,
    /// It is within the limits.
    pub met: bool,
}

impl Aim {
    /// The value that each method, or the best one, reached; none where the study has none of the cells.
    #[must_use]
    pub fn reached<'a>(&'a self, study: &'a Study) -> Vec<Reached<'a>> {
        let mut all: Vec<Reached> = self.method.iter().filter_map(|m| self.by(m, study)).collect();
        if self.best {
            all.sort_by(|a, b| self.excess(a.value).total_cmp(&self.excess(b.value)));
            all.truncate(1);
        }
        all
    }

    fn by<'a>(&self, method: &'a str, study: &'a Study) -> Option<Reached<'a>> {
        let cells: Vec<(&Cell, Option<f64>)> = study
            .cells
            .iter()
            .filter(|c| c.method_text() == method && self.cells.holds(c))
            .map(|c| (c, self.of(c)))
            .collect();
        let (cell, value) = if self.each {
            // A cell without the number is as far off as can be.
            let (cell, value) = (cells.into_iter().map(|(c, v)| (c, v.unwrap_or(f64::INFINITY))))
                .max_by(|a, b| self.excess(a.1).total_cmp(&self.excess(b.1)))?;
            (Some(cell), value)
        } else {
            (None, stats::mean(cells.into_iter().filter_map(|(_, v)| v))?)
        };
        Some(Reached { method, value, cell, met: self.excess(value) <= 0.0 })
    }

    /// The distance of a value beyond the limits.
    fn excess(&self, value: f64) -> f64 {
        let above = self.at_most.map(|most| value - most);
        let below = self.at_least.map(|least| least - value);
        above.into_iter().chain(below).fold(f64::NEG_INFINITY, f64::max)
    }

    fn of(&self, cell: &Cell) -> Option<f64> {
        match self.measure {
            Measure::RmsSamples => {
                cell.kept.iter().find(|k| k.percent == self.kept_percent)?.rms_samples
            }
            Measure::RmsOverBound => Some(cell.rms_samples? / cell.bound_rms_samples?),
            Measure::Flagged => Some(cell.flagged as f64 / cell.trials.max(1) as f64),
            Measure::Coverage95 => cell.coverage95,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn study(cells: &[(&str, f64, f64, usize)]) -> Study {
        let cell = |(method, rms, bound, flagged): &(&str, f64, f64, usize)| {
            serde_json::json!({
                "plant": "slow1", "input": "u", "output": "y", "c2d": "zoh", "excitation": "rbs", "snr": 100, "noise": "white", "loop": "open", "place": "u",
                "delay_s": 1.0, "truth": "delay", "method": method, "options": {}, "trials": 10, "rms_samples": rms, "rms_ci95_samples": null,
                "bias_samples": null, "flagged": flagged, "unflagged_wrong": 0, "coverage95": null, "bound_rms_samples": bound,
                "time_per_estimate_s": null, "kept": [{ "percent": 100.0, "rms_samples": rms }, { "percent": 90.0, "rms_samples": 0.5 * rms }]
            })
        };
        let cells: Vec<_> = cells.iter().map(cell).collect();
        serde_json::from_value(serde_json::json!({ "format": "", "plan": "", "seed": 1, "program": "", "cells": cells })).unwrap()
    }

    fn aim(text: &str) -> Aim {
        toml::from_str(&format!("aim = \"\"\ncells = {{}}\n{text}")).unwrap()
    }

    #[test]
    fn means_worst_cells_and_best_methods() {
        let study = study(&[
            ("a", 1.0, 1.0, 0),
            ("a", 3.0, 1.0, 5),
            ("b", 1.5, 1.0, 10),
            ("b", 1.5, 2.0, 10),
        ]);
        let values = |text: &str| {
            aim(text)
                .reached(&study)
                .iter()
                .map(|r| (r.method.to_owned(), r.value, r.met))
                .collect::<Vec<_>>()
        };
        let both = "method = [\"a\", \"b\"]\n";
        let of = |name: &str, value, met| (name.to_owned(), value, met);
        assert_eq!(
            values(&format!("{both}measure = \"rms_samples\"\nat_most = 1.5")),
            [of("a", 2.0, false), of("b", 1.5, true)]
        );
        assert_eq!(
            values(&format!("{both}best = true\nmeasure = \"rms_samples\"\nat_most = 1.5")),
            [of("b", 1.5, true)]
        );
        assert_eq!(
            values(&format!("{both}kept_percent = 90\nmeasure = \"rms_samples\"\nat_most = 1")),
            [of("a", 1.0, true), of("b", 0.75, true)]
        );
        assert_eq!(
            values(&format!("{both}each = true\nmeasure = \"rms_over_bound\"\nat_most = 1.2")),
            [of("a", 3.0, false), of("b", 1.5, false)]
        );
        assert_eq!(
            values(&format!("{both}each = true\nmeasure = \"flagged\"\nat_least = 0.99")),
            [of("a", 0.0, false), of("b", 1.0, true)]
        );
        // No interval at all is no coverage.
        assert_eq!(
            values(&format!(
                "{both}each = true\nmeasure = \"coverage95\"\nat_least = 0.9\nat_most = 0.97"
            ))
            .iter()
            .filter(|v| v.2)
            .count(),
            0
        );
        assert!(values("method = [\"c\"]\nmeasure = \"flagged\"\nat_least = 0.9").is_empty());
    }
}
