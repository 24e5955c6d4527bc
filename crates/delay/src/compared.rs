//! Process models, transfer functions and subspace models of the same records, compared on validation data. The comparison recommends the simplest model that
//! none outperforms significantly.
//!
//! How it can be wrong: the validation data select, so the selected model's fit on them is optimistic; held-out data must be others. Correlated blocks make the
//! standard error too small, so a larger model is selected. Under feedback, free runs of biased models fit well; methods that assume an open loop are therefore
//! not eligible there.
//!
//! Source of the rule: the one-standard-error rule, Breiman et al. (1984), "Classification and Regression Trees", section 3.4.3, on paired differences over blocks.

use nalgebra::DMatrix;
use serde::Serialize;
use serde_json::{Value, json};

use super::behind_delays::{BehindDelays, TakenOut, feedback, identify_behind_delays};
use super::error::Result;
use super::identifiers::{IDENTIFIERS, identifier};
use deadtime_identify::IdentifyError;
use deadtime_identify::subspace::{Identified, Recordings, Stretch};
use deadtime_log::Log;
use deadtime_signal::progress::HowFar;
use deadtime_signal::stop::Stop;

/// Contiguous blocks of the validation data over which errors are compared.
const BLOCKS: usize = 10;
/// 95 % quantile, one-sided, of Student's t with `BLOCKS` − 1 degrees of freedom. A candidate whose excess error over the best is below it is within the noise.
const T_95: f64 = 1.833;
/// Coefficients of F and of B of the candidate transfer functions.
const TRANSFER: [[usize; 2]; 5] = [[1, 1], [2, 1], [2, 2], [3, 2], [4, 3]];

/// A model that was tried.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Candidate {
    /// The method.
    pub method: &'static str,
    /// Its options other than the defaults, a JSON object.
    pub options: Value,
    /// Dead time of each input, s; empty where the fit failed.
    pub dead_time_s: Vec<f64>,
    /// States.
    pub order: Option<usize>,
    /// Fitted parameters, dead times included.
    pub parameters: Option<usize>,
    /// 100·(1 − rms error/standard deviation) on the validation data, over all outputs.
    pub fit_percent: Option<f64>,
    /// Its validation error does not exceed the best one's by more than the noise.
    pub as_good_as_best: bool,
    /// This is the recommended candidate.
    pub chosen: bool,
    /// Why it is not eligible, or why it failed.
    pub why_not: Option<String>,
}

/// All candidates, and the error by which they are compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// The candidates in order of validation error; failed ones last.
    pub candidates: Vec<Candidate>,
    /// Errors are those of free runs; `false`: of one-step predictions, because no free run beats the mean.
    pub free_run: bool,
}

impl Comparison {
    /// The recommended candidate.
    #[must_use]
    pub fn chosen(&self) -> Option<&Candidate> {
        self.candidates.iter().find(|c| c.chosen)
    }
}

/// A candidate with its squared errors: per stretch, over the outputs' variances, of free runs and of one-step predictions.
struct Tried {
    candidate: Candidate,
    errors: Option<[Vec<Vec<f64>>; 2]>,
}

/// Fits every method to `training` and compares the models on `validation`; dead times are estimated in the records `logs`.
///
/// # Errors
/// Where no method gives a model, the last method's error.
pub fn compare_models(
    training: &Recordings,
    validation: &Recordings,
    logs: &[Log],
    (stop, far): (&Stop, &HowFar),
) -> Result<Comparison> {
    let plan = plan(training);
    let looped = IDENTIFIERS.iter().any(|line| !feedback(line, training).is_empty());
    let mut tried: Vec<Tried> = Vec::new();
    let mut delays: Option<Vec<(String, f64)>> = None;
    let mut failed = None;
    for (at, (method, options)) in plan.iter().enumerate() {
        stop.check()?;
        let part = |at: usize| at as f64 / plan.len() as f64;
        far.at(part(at), &format_args!("{method}, {} of {}", at + 1, plan.len()));
        // The dead times of state-space models are estimated once.
        let removed = delays.clone().map_or(TakenOut::Estimated, TakenOut::Given);
        let own = identifier(method)?.finds_delays;
        let removed = if own { TakenOut::Estimated } else { removed };
        let quiet = (stop, &HowFar::default());
        match identify_behind_delays(training, logs, method, options, &removed, quiet) {
            Ok(found) => {
                if !own && delays.is_none() {
                    let of = |d: &usize| training.sample_time.to_seconds(*d as f64);
                    let names = training.inputs.iter().map(|i| i.name.clone());
                    delays = Some(names.zip(found.delays.iter().map(of)).collect());
                }
                let biased = looped && identifier(method)?.open_loop;
                tried.push(judged((method, options), &found, validation, biased)?);
            }
            Err(error) => {
                tried.push(Tried { candidate: failure(method, options, &error), errors: None });
                failed = Some(error);
            }
        }
    }
    let compared = compare(tried);
    match (compared.chosen().is_some(), failed) {
        (false, Some(error)) => Err(error),
        (false, None) => Err(IdentifyError::Numeric {
            method: "identify",
            reason: "no method gives a model that predicts the validation data",
        }
        .into()),
        _ => Ok(compared),
    }
}

/// The candidates for these records: process models only for one input and one output, transfer functions only for one output.
fn plan(training: &Recordings) -> Vec<(&'static str, Value)> {
    let (inputs, outputs) = (training.inputs.len(), training.outputs.len());
    let mut plan = Vec::new();
    for line in IDENTIFIERS {
        match (line.entry.name, line.finds_delays) {
            ("riv", _) if outputs == 1 => plan.extend(
                TRANSFER.map(|[nf, nb]| ("riv", json!({ "nf": nf, "nb": nb, "draws": 0 }))),
            ),
            (name, false) => plan.push((name, json!({ "draws": 0 }))),
            (name, true) if name != "riv" && inputs == 1 && outputs == 1 => {
                plan.push((name, json!({ "draws": 0 })));
            }
            _ => {}
        }
    }
    plan
}

fn failure(method: &'static str, options: &Value, error: &super::error::Error) -> Candidate {
    Candidate {
        method,
        options: options.clone(),
        dead_time_s: Vec::new(),
        order: None,
        parameters: None,
        fit_percent: None,
        as_good_as_best: false,
        chosen: false,
        why_not: Some(error.to_string()),
    }
}

/// A model's errors on the validation data. A model biased by feedback is listed, and not eligible.
fn judged(
    (method, options): (&'static str, &Value),
    found: &BehindDelays,
    validation: &Recordings,
    biased: bool,
) -> Result<Tried> {
    let m = &found.model;
    let behind = validation.behind_delays(&found.delays)?;
    let centred: Vec<Stretch> = behind.stretches.iter().map(|s| m.scales.centred(s)).collect();
    let free: Vec<DMatrix<f64>> = centred.iter().map(|s| &s.y - m.model.free_run(s)).collect();
    let ahead: Vec<DMatrix<f64>> = centred.iter().map(|s| m.model.innovations(s)).collect();
    let spread = variances(validation);
    let square = |errors: &[DMatrix<f64>]| -> Vec<Vec<f64>> {
        let at = |e: &DMatrix<f64>, t: usize| {
            let parts = spread.iter().enumerate().filter(|(_, v)| **v > 0.0);
            parts.map(|(i, v)| e[(i, t)].powi(2) / v).sum::<f64>()
        };
        errors.iter().map(|e| (0..e.ncols()).map(|t| at(e, t)).collect()).collect()
    };
    let why_not = "assumes an open loop, and the input depends on the output";
    let candidate = Candidate {
        method,
        options: options.clone(),
        dead_time_s: dead_times(m, &found.delays),
        order: Some(m.model.order()),
        parameters: Some(parameters(m)),
        fit_percent: None,
        as_good_as_best: false,
        chosen: false,
        why_not: biased.then(|| why_not.to_owned()),
    };
    Ok(Tried { candidate, errors: Some([square(&free), square(&ahead)]) })
}

/// The variance of each output over all stretches, times the number of moving outputs: a sum over outputs is then a mean.
fn variances(of: &Recordings) -> Vec<f64> {
    let each: Vec<f64> = (0..of.outputs.len())
        .map(|i| {
            let all =
                || of.stretches.iter().flat_map(|s| s.y.row(i).iter().copied().collect::<Vec<_>>());
            let n = all().count().max(1) as f64;
            let mean = all().sum::<f64>() / n;
            all().map(|v| (v - mean).powi(2)).sum::<f64>() / n
        })
        .collect();
    let moving = each.iter().filter(|v| **v > 0.0).count() as f64;
    each.iter().map(|v| v * moving).collect()
}

/// Dead time of each input: the fitted one of a process model, else whole samples.
fn dead_times(m: &Identified, delays: &[usize]) -> Vec<f64> {
    let fitted = m.parametric.iter().flat_map(|p| &p.parameters);
    let fitted: Vec<f64> = fitted.filter(|p| p.name == "dead_time").map(|p| p.value).collect();
    if fitted.len() == delays.len() {
        return fitted;
    }
    delays.iter().map(|d| m.sample_time.to_seconds(*d as f64)).collect()
}

/// Fitted parameters and dead times: those of a given structure, else the free entries of a canonical form of A, B, C and K.
fn parameters(m: &Identified) -> usize {
    let (n, inputs, outputs) = (m.model.order(), m.inputs.len(), m.outputs.len());
    match &m.parametric {
        Some(p) if p.continuous.is_some() => p.parameters.len(),
        Some(p) => p.parameters.len() + inputs,
        None => n * (inputs + 2 * outputs) + inputs,
    }
}

/// The error of every block: the mean over the samples common to all candidates.
fn blocks(errors: &[Vec<f64>], lengths: &[usize]) -> Vec<f64> {
    let all: Vec<f64> = errors
        .iter()
        .zip(lengths)
        .flat_map(|(e, keep)| e.iter().skip(e.len() - keep).copied())
        .collect();
    let size = all.len().div_ceil(BLOCKS).max(1);
    all.chunks(size).map(|c| c.iter().sum::<f64>() / c.len() as f64).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Selects the simplest eligible candidate that the best does not outperform significantly.
fn compare(mut tried: Vec<Tried>) -> Comparison {
    let stretches = tried
        .iter()
        .filter_map(|t| t.errors.as_ref())
        .map(|[free, _]| free.len())
        .min()
        .unwrap_or(0);
    let lengths: Vec<usize> = (0..stretches)
        .map(|s| {
            let of = |t: &Tried| t.errors.as_ref().and_then(|[free, _]| free.get(s)).map(Vec::len);
            tried.iter().filter_map(of).min().unwrap_or(0)
        })
        .collect();
    let of = |t: &Tried, kind: usize| -> Option<Vec<f64>> {
        let all = blocks(t.errors.as_ref()?.get(kind)?, &lengths);
        (!all.is_empty() && all.iter().all(|v| v.is_finite())).then_some(all)
    };
    let free: Vec<Option<Vec<f64>>> = tried.iter().map(|t| of(t, 0)).collect();
    let free_run = free.iter().flatten().any(|b| mean(b) < 1.0);
    let errors: Vec<Option<Vec<f64>>> =
        if free_run { free } else { tried.iter().map(|t| of(t, 1)).collect() };
    let eligible = |at: usize| tried.get(at).is_some_and(|t| t.candidate.why_not.is_none());
    let known = || errors.iter().enumerate().filter_map(|(at, e)| Some((at, e.as_ref()?)));
    let best =
        known().filter(|(at, _)| eligible(*at)).min_by(|a, b| mean(a.1).total_cmp(&mean(b.1)));
    let best = best.map(|(_, e)| e.clone());
    let within: Vec<bool> = errors
        .iter()
        .map(|e| e.as_ref().zip(best.as_ref()).is_some_and(|(e, best)| within_noise(e, best)))
        .collect();
    for ((t, e), within) in tried.iter_mut().zip(&errors).zip(within) {
        t.candidate.fit_percent = e.as_ref().map(|e| 100.0 * (1.0 - mean(e).sqrt()));
        t.candidate.as_good_as_best = within;
    }
    let mut candidates: Vec<Candidate> = tried.into_iter().map(|t| t.candidate).collect();
    let fit = |c: &Candidate| c.fit_percent.unwrap_or(f64::NEG_INFINITY);
    candidates.sort_by(|a, b| fit(b).total_cmp(&fit(a)));
    let simplest = candidates
        .iter()
        .enumerate()
        .filter(|(_, c)| c.as_good_as_best && c.why_not.is_none())
        .min_by_key(|(at, c)| (c.parameters, *at))
        .map(|(at, _)| at);
    if let Some(chosen) = simplest.and_then(|at| candidates.get_mut(at)) {
        chosen.chosen = true;
    }
    Comparison { candidates, free_run }
}

/// The mean excess over the best is below [`T_95`] standard errors of the paired differences.
fn within_noise(errors: &[f64], best: &[f64]) -> bool {
    let excess: Vec<f64> = errors.iter().zip(best).map(|(e, b)| e - b).collect();
    let (n, centre) = (excess.len() as f64, mean(&excess));
    let square = excess.iter().map(|d| (d - centre).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    centre <= T_95 * (square / n).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_log::Channel;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const STEP_S: f64 = 0.1;

    /// Random binary input held for ten samples; y = Σ b·u(t − delay − 1) − Σ a·y, with white noise of this standard deviation. Feedback moves the input by
    /// −`gain`·y.
    fn record(a: &[f64], b: f64, delay: usize, noise: f64, gain: f64, seed: u64) -> Log {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let (mut u, mut clean, mut y) = (Vec::new(), Vec::new(), Vec::new());
        let mut level = 1.0;
        for t in 0..1500_usize {
            if t % 10 == 0 {
                level = if normal() > 0.0 { 1.0 } else { -1.0 };
            }
            let late = t.checked_sub(delay + 1).and_then(|k| u.get(k)).copied().unwrap_or(0.0);
            let past = |k: usize| t.checked_sub(k).and_then(|k| clean.get(k)).copied();
            let own: f64 = a.iter().enumerate().map(|(k, a)| a * past(k + 1).unwrap_or(0.0)).sum();
            clean.push(b * late - own);
            y.push(clean.last().copied().unwrap_or(0.0) + noise * normal());
            u.push(level - gain * y.last().copied().unwrap_or(0.0));
        }
        let time_s = (0..y.len()).map(|k| k as f64 * STEP_S).collect();
        Log::new("drawn", time_s, vec![Channel::new("u", None, u), Channel::new("y", None, y)])
            .unwrap()
    }

    fn compared(log: Log) -> Comparison {
        let logs = [log];
        let all = Recordings::from_logs(&logs, &["u".to_owned()], &["y".to_owned()]).unwrap();
        let (training, validation) = all.split(0.7);
        compare_models(&training, &validation, &logs, (&Stop::default(), &HowFar::default()))
            .unwrap()
    }

    fn one_lag(cases: &[(u64, usize)]) {
        for &(seed, delay) in cases {
            let found = compared(record(&[-0.9], 0.1, delay, 0.05, 0.0, seed));
            let chosen = found.chosen().unwrap();
            assert!(found.free_run);
            assert!(chosen.parameters.unwrap() <= 4, "{seed}: {chosen:?}");
            let truth = delay as f64 * STEP_S;
            assert!((chosen.dead_time_s[0] - truth).abs() <= 0.5 * STEP_S, "{seed}: {chosen:?}");
        }
    }

    #[test]
    fn of_one_lag_with_dead_time_the_chosen_model_is_small_and_has_the_dead_time() {
        one_lag(&[(1, 3)]);
    }

    #[test]
    #[ignore = "nightly: more draws"]
    fn of_one_lag_with_any_dead_time_the_chosen_model_is_small_and_has_the_dead_time() {
        one_lag(&[(2, 7), (3, 0), (4, 12)]);
    }

    fn resonance(seeds: &[u64]) {
        for &seed in seeds {
            let found = compared(record(&[-1.8, 0.9], 0.1, 2, 0.05, 0.0, seed));
            let chosen = found.chosen().unwrap();
            assert!(chosen.order.unwrap() >= 2 && !chosen.method.starts_with("p1"), "{chosen:?}");
            let small = found.candidates.iter().find(|c| c.method == "p1d").unwrap();
            assert!(!small.as_good_as_best && small.fit_percent < chosen.fit_percent, "{small:?}");
        }
    }

    #[test]
    fn of_a_resonance_no_model_of_real_poles_is_chosen() {
        resonance(&[4]);
    }

    #[test]
    #[ignore = "nightly: more draws"]
    fn of_more_resonances_no_model_of_real_poles_is_chosen() {
        resonance(&[5, 6]);
    }

    #[test]
    fn under_feedback_only_methods_that_bear_it_are_eligible() {
        let found = compared(record(&[-0.9], 0.3, 1, 0.3, 0.8, 6));
        let chosen = found.chosen().unwrap();
        assert_eq!(chosen.method, "pbsidopt", "{found:?}");
        let riv = found.candidates.iter().find(|c| c.method == "riv").unwrap();
        assert!(riv.why_not.as_ref().unwrap().contains("open loop"), "{riv:?}");
    }

    #[test]
    fn an_excess_is_noise_up_to_its_own_spread() {
        let best = [1.0, 1.2, 0.8, 1.1, 0.9, 1.0, 1.2, 0.8, 1.1, 0.9];
        let worse: Vec<f64> = best.iter().map(|b| b + 0.1).collect();
        assert!(within_noise(&best, &best) && !within_noise(&worse, &best));
        let as_good: Vec<f64> = best
            .iter()
            .enumerate()
            .map(|(i, b)| b + if i % 2 == 0 { 0.1 } else { -0.09 })
            .collect();
        assert!(within_noise(&as_good, &best));
    }
}
