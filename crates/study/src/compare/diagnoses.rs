//! Diagnoses side by side: what causes each gap, and whether they agree on the numbers.
//!
//! How this can be wrong:
//! - Intervals hold the noise of a log. Two diagnoses with one wrong model structure agree, and both are off.
//! - Of many parameters some differ by chance: the level of each test is divided by their number.
//! - One cause may have another's name where the data cannot distinguish them: an alias of a cause is matched with it, and reported.
//! - Errors are relative to the motion of each one's own logs: other manoeuvres, other errors, though nothing was repaired.

use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::compare::CompareFormat;
use deadtime_gap::{Contribution, Diagnosis, Explained, FoundParameter, Mode, Strength};
use deadtime_signal::stats::NORMAL_95;

/// The probability of any reported difference where there is none.
const LEVEL: f64 = 0.05;
/// The name of the parameters of the model where they were freed as a group.
const RECALIBRATED: &str = "parameters recalibrated";

/// Several diagnoses side by side.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Diagnoses {
    /// The format line.
    pub format: CompareFormat,
    /// The name of each.
    pub names: Vec<String>,
    /// The results of each, in the order of the names.
    pub diagnoses: Vec<GapStanding>,
    /// Every cause of any of them, what most have first.
    pub causes: Vec<CauseRow>,
    /// Every number of a cause that two or more of them give.
    pub parameters: Vec<ParameterRow>,
    /// The level of each test: 0.05 over their number.
    pub level: f64,
}

/// The results of one diagnosis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GapStanding {
    /// The model's name.
    pub model: String,
    /// The leading effect, `none` or `unknown`.
    pub verdict: String,
    /// The explained part of the gap; missing in files of `deadtime/diagnosis@1`.
    pub explained: Option<Explained>,
    /// How outputs were predicted.
    pub mode: Mode,
    /// Held-out nrmse of the nominal model.
    pub before: Option<f64>,
    /// Held-out nrmse of the model with the found effects.
    pub after: Option<f64>,
    /// The held-out floor.
    pub floor: Option<f64>,
    /// 1 − after/before.
    pub fraction: Option<f64>,
    /// Its 95 % interval.
    pub ci95: Option<[f64; 2]>,
}

/// A cause, and what part each diagnosis gives it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CauseRow {
    /// `effect:channel`.
    pub cause: String,
    /// Per diagnosis; missing where it was not found.
    pub parts: Vec<Option<CausePart>>,
}

/// A cause in one diagnosis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CausePart {
    /// The cause's held-out share of the gap, or the training share without one; missing in files of `deadtime/diagnosis@1`.
    pub share: Option<f64>,
    /// How clearly it shows; missing there too.
    pub strength: Option<Strength>,
    /// The `effect:channel` of this diagnosis, where it is an alias of the cause of this row.
    pub stands_in: Option<String>,
}

/// A number of a cause over the diagnoses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParameterRow {
    /// `effect:channel`.
    pub cause: String,
    /// The parameter.
    pub parameter: String,
    /// Its unit.
    pub unit: String,
    /// Per diagnosis; missing where it was not found, or has another unit.
    pub values: Vec<Option<CauseValue>>,
    /// Whether one value describes all: Cochran's Q (1954, Biometrics 10(1), 101-129, doi:10.2307/3001666) at the level of the comparison. Missing where fewer
    /// than two have an interval.
    pub agree: Option<bool>,
    /// The chance of values as different as these where one value holds for all.
    pub p_value: Option<f64>,
    /// The mean, weighted by the intervals.
    pub mean: Option<f64>,
    /// Its 95 % interval, if one value holds for all.
    pub mean_ci95: Option<[f64; 2]>,
    /// The standard deviation between the diagnoses that their intervals do not account for (DerSimonian and Laird 1986, Controlled Clinical Trials 7(3), 177-188,
    /// doi:10.1016/0197-2456(86)90046-2).
    pub spread: Option<f64>,
}

/// A number of one diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CauseValue {
    /// The number.
    pub value: f64,
    /// Its 95 % interval; missing at a bound.
    pub ci95: Option<[f64; 2]>,
}

/// A cause with its parts.
struct Found<'a> {
    key: String,
    parameters: &'a [FoundParameter],
    part: CausePart,
    class: &'a [String],
}

/// Diagnoses side by side, each with its name.
#[must_use]
pub fn diagnoses(named: &[(String, Diagnosis)]) -> Diagnoses {
    let found: Vec<Vec<Found<'_>>> = named.iter().map(|(_, d)| causes_of(d)).collect();
    let causes = cause_rows(&found);
    let mut parameters = parameter_rows(&causes, &found);
    let tests = parameters.iter().filter(|p| p.p_value.is_some()).count();
    let level = LEVEL / tests.max(1) as f64;
    for row in &mut parameters {
        row.agree = row.p_value.map(|p| p >= level);
    }
    Diagnoses {
        format: CompareFormat::V1,
        names: named.iter().map(|(name, _)| name.clone()).collect(),
        diagnoses: named.iter().map(|(_, d)| standing(d)).collect(),
        causes,
        parameters,
        level,
    }
}

impl Diagnoses {
    /// Causes that every diagnosis has.
    #[must_use]
    pub fn common(&self) -> Vec<&CauseRow> {
        self.causes.iter().filter(|c| c.parts.iter().all(Option::is_some)).collect()
    }

    /// Causes that the first has and the last has not, and the other way round.
    #[must_use]
    pub fn gone_and_new(&self) -> [Vec<&CauseRow>; 2] {
        let ends = |row: &CauseRow| {
            [row.parts.first(), row.parts.last()].map(|p| p.is_some_and(Option::is_some))
        };
        [[true, false], [false, true]]
            .map(|wanted| self.causes.iter().filter(|row| ends(row) == wanted).collect())
    }
}

fn standing(d: &Diagnosis) -> GapStanding {
    GapStanding {
        model: d.model.clone(),
        verdict: d.cause.verdict.clone(),
        explained: d.cause.explained,
        mode: d.prediction.mode,
        before: d.shrink.before,
        after: d.shrink.after,
        floor: d.shrink.floor,
        fraction: d.shrink.fraction,
        ci95: d.shrink.ci95,
    }
}

/// The contributions; in a file of `deadtime/diagnosis@1` the effects of its verdict.
fn causes_of(d: &Diagnosis) -> Vec<Found<'_>> {
    let contributing = |c: &'_ Contribution| CausePart {
        share: c.share.held_out.or(c.share.learnt),
        strength: Some(c.strength),
        stands_in: None,
    };
    let mut found: Vec<Found<'_>> = d
        .cause
        .contributions
        .iter()
        .map(|c| Found {
            key: key(&c.effect, &c.channel),
            parameters: &c.parameters,
            part: contributing(c),
            class: &c.class,
        })
        .collect();
    if found.is_empty() {
        let class = |key: &str| {
            d.cause
                .indistinguishable
                .iter()
                .find(|class| class.iter().any(|k| k == key))
                .map_or(&[][..], Vec::as_slice)
        };
        found.extend(d.cause.effects.iter().map(|e| {
            let key = key(&e.effect, &e.channel);
            Found {
                class: class(&key),
                key,
                parameters: &e.parameters,
                part: CausePart { share: None, strength: None, stands_in: None },
            }
        }));
    }
    if let Some(all) = d.cause.recalibration.as_ref().filter(|r| r.accepted) {
        let part = CausePart {
            share: all.share.held_out.or(all.share.learnt),
            strength: None,
            stands_in: None,
        };
        found.push(Found {
            key: RECALIBRATED.to_owned(),
            parameters: &all.parameters,
            part,
            class: &[],
        });
    }
    found
}

fn key(effect: &str, channel: &str) -> String {
    format!("{effect}:{channel}")
}

fn cause_rows(found: &[Vec<Found<'_>>]) -> Vec<CauseRow> {
    // The number of diagnoses with this very name: the commonest name heads the row.
    let mut names: Vec<(&str, usize)> = Vec::new();
    for cause in found.iter().flatten() {
        match names.iter_mut().find(|(name, _)| *name == cause.key) {
            Some((_, count)) => *count += 1,
            None => names.push((&cause.key, 1)),
        }
    }
    names.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let mut taken: Vec<Vec<bool>> = found.iter().map(|causes| vec![false; causes.len()]).collect();
    let mut rows = Vec::new();
    for (name, _) in names {
        let parts = found.iter().zip(&mut taken).map(|(causes, taken)| {
            let itself = causes.iter().position(|c| c.key == name);
            // Its own name first; else an alias in the data, which then has no separate row here.
            let at = itself.or_else(|| {
                causes
                    .iter()
                    .zip(taken.iter())
                    .position(|(c, taken)| !taken && c.class.iter().any(|k| k == name))
            })?;
            let (cause, taken) = (causes.get(at)?, taken.get_mut(at)?);
            if *taken {
                return None;
            }
            *taken = true;
            let stands_in = itself.is_none().then(|| cause.key.clone());
            Some(CausePart { stands_in, ..cause.part.clone() })
        });
        let parts: Vec<Option<CausePart>> = parts.collect();
        if parts.iter().any(Option::is_some) {
            rows.push(CauseRow { cause: name.to_owned(), parts });
        }
    }
    rows.sort_by_key(|row| std::cmp::Reverse(row.parts.iter().flatten().count()));
    rows
}

fn parameter_rows(causes: &[CauseRow], found: &[Vec<Found<'_>>]) -> Vec<ParameterRow> {
    let mut rows: Vec<ParameterRow> = Vec::new();
    for cause in causes {
        // Another effect's numbers have another meaning.
        let of = |causes: &'_ Vec<Found<'_>>| {
            causes
                .iter()
                .find(|c| c.key == cause.cause)
                .map(|c| c.parameters.to_vec())
                .unwrap_or_default()
        };
        let each: Vec<Vec<FoundParameter>> = found.iter().map(of).collect();
        for p in each.iter().flatten() {
            if rows.iter().any(|r| r.cause == cause.cause && r.parameter == p.name) {
                continue;
            }
            let value = |parameters: &Vec<FoundParameter>| {
                let same = parameters.iter().find(|q| q.name == p.name && q.unit == p.unit)?;
                Some(CauseValue { value: same.value.filter(|v| v.is_finite())?, ci95: same.ci95 })
            };
            let values: Vec<Option<CauseValue>> = each.iter().map(value).collect();
            if values.iter().flatten().count() > 1 {
                rows.push(row(&cause.cause, &p.name, &p.unit, values));
            }
        }
    }
    rows
}

fn row(cause: &str, parameter: &str, unit: &str, values: Vec<Option<CauseValue>>) -> ParameterRow {
    let (cause, parameter, unit) = (cause.to_owned(), parameter.to_owned(), unit.to_owned());
    let blank = ParameterRow {
        cause,
        parameter,
        unit,
        values,
        agree: None,
        p_value: None,
        mean: None,
        mean_ci95: None,
        spread: None,
    };
    let known: Vec<[f64; 2]> = blank
        .values
        .iter()
        .flatten()
        .filter_map(|v| v.ci95.map(|[low, high]| [v.value, 0.5 * (high - low) / NORMAL_95]))
        .filter(|[_, std]| *std > 0.0 && std.is_finite())
        .collect();
    let Some(freedom) = known.len().checked_sub(1).filter(|f| *f > 0) else { return blank };
    let weights: Vec<f64> = known.iter().map(|[_, std]| std.powi(-2)).collect();
    let weight: f64 = weights.iter().sum();
    let mean = known.iter().zip(&weights).map(|([v, _], w)| v * w).sum::<f64>() / weight;
    let q: f64 = known.iter().zip(&weights).map(|([v, _], w)| w * (v - mean).powi(2)).sum();
    let Ok(chance) = ChiSquared::new(freedom as f64) else { return blank };
    if !q.is_finite() {
        return blank;
    }
    let unlike = weight - weights.iter().map(|w| w * w).sum::<f64>() / weight;
    let half = NORMAL_95 / weight.sqrt();
    ParameterRow {
        p_value: Some(chance.sf(q)),
        mean: Some(mean),
        mean_ci95: Some([mean - half, mean + half]),
        spread: Some(((q - freedom as f64) / unlike).max(0.0).sqrt()),
        ..blank
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_abs_diff_eq;

    use super::*;

    fn values(of: &[(f64, f64)]) -> Vec<Option<CauseValue>> {
        of.iter()
            .map(|(value, half)| {
                Some(CauseValue { value: *value, ci95: Some([value - half, value + half]) })
            })
            .collect()
    }

    #[test]
    fn two_values_are_compared_as_their_difference_is() {
        // Two values with standard deviations 0.3 and 0.4 that are 1 apart. (1/0.5)² = 4 on one degree of freedom, p = 0.0455 (tables of the normal
        // distribution, 2 σ).
        let row = row("a:b", "p", "s", values(&[(1.0, 0.3 * NORMAL_95), (2.0, 0.4 * NORMAL_95)]));
        assert_abs_diff_eq!(row.p_value.unwrap(), 0.045_500_263_9, epsilon = 1e-9);
        // Weights 1/0.09 and 1/0.16.
        assert_abs_diff_eq!(
            row.mean.unwrap(),
            (1.0 / 0.09 + 2.0 / 0.16) / (1.0 / 0.09 + 1.0 / 0.16),
            epsilon = 1e-12
        );
        // Half the squared distance less the mean variance: 0.5 − 0.125.
        assert_abs_diff_eq!(row.spread.unwrap(), 0.375_f64.sqrt(), epsilon = 1e-12);
    }

    #[test]
    fn without_two_intervals_nothing_is_tested() {
        let mut some = values(&[(1.0, 0.1), (2.0, 0.1)]);
        some[1].as_mut().unwrap().ci95 = None;
        assert_eq!(row("a:b", "p", "s", some).p_value, None);
        assert_eq!(
            row("a:b", "p", "s", values(&[(1.0, 0.0), (2.0, 0.0)])).p_value,
            None,
            "no width"
        );
    }

    fn found<'a>(key: &str, class: &'a [String]) -> Found<'a> {
        Found {
            key: key.into(),
            parameters: &[],
            part: CausePart { share: Some(0.5), strength: None, stands_in: None },
            class,
        }
    }

    #[test]
    fn what_stands_in_for_a_cause_is_matched_with_it() {
        let class = vec!["input_delay:u".to_owned(), "output_delay:*".to_owned()];
        let rows = cause_rows(&[
            vec![found("input_delay:u", &class)],
            vec![found("output_delay:*", &class)],
            vec![found("input_delay:u", &class)],
        ]);
        assert_eq!(rows.len(), 1);
        assert_eq!(rows[0].cause, "input_delay:u");
        let stand_ins: Vec<Option<String>> =
            rows[0].parts.iter().map(|p| p.clone().unwrap().stands_in).collect();
        assert_eq!(stand_ins, [None, Some("output_delay:*".to_owned()), None]);
    }

    #[test]
    fn one_that_has_both_keeps_both() {
        let class = vec!["input_delay:u".to_owned(), "output_delay:*".to_owned()];
        let rows = cause_rows(&[
            vec![found("input_delay:u", &class), found("output_delay:*", &class)],
            vec![found("output_delay:*", &class)],
        ]);
        let names: Vec<&str> = rows.iter().map(|r| r.cause.as_str()).collect();
        assert_eq!(names, ["output_delay:*", "input_delay:u"]);
        assert!(rows[1].parts[1].is_none());
    }
}
