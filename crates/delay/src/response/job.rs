//! Dead times of a measured frequency response, with their verdict.

use super::estimator::{ResponseEstimator, ResponseMethod, ResponseSearch, ends};
use super::methods::RESPONSE_METHODS;
use crate::error::{DelayError, Result};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::usable;
use crate::job::chosen::{known, options_of};
use crate::report::{Estimate, FORMAT, Pair, Report, Searched};
use crate::verdict::conclusion::{Grounds, Verdict};
use deadtime_log::FrequencyResponse;
use deadtime_signal::stop::Stop;
use serde_json::Value;
use std::time::Instant;

/// The configuration of an estimation from a frequency response; [`ResponseJob::new`] has every method and the defaults.
pub struct ResponseJob {
    /// The response.
    pub response: FrequencyResponse,
    /// The names of its input and its output.
    pub channels: [String; 2],
    /// Names of methods, or `all`.
    pub methods: Vec<String>,
    /// Options by method, JSON objects.
    pub options: std::collections::BTreeMap<String, Value>,
    /// Longest delay to search, s. `None`: 40 periods of the highest frequency, at most half of the longest delay that the frequency spacing resolves.
    pub max_delay_s: Option<f64>,
    /// Cancellation, checked between methods, and inside long scans.
    pub stop: Stop,
}

/// A band is narrow if its highest frequency is below this multiple of the lowest.
pub(super) const NARROW: f64 = 4.0;

/// Default search window in periods of the highest frequency.
pub(super) const PERIODS: f64 = 40.0;

impl ResponseJob {
    /// Every method with its defaults.
    #[must_use]
    pub fn new(response: FrequencyResponse) -> Self {
        Self {
            response,
            channels: ["input".to_owned(), "output".to_owned()],
            methods: vec!["all".to_owned()],
            options: std::collections::BTreeMap::new(),
            max_delay_s: None,
            stop: Stop::default(),
        }
    }

    /// Estimates by every requested method.
    ///
    /// # Errors
    /// `RegistryError` for an unknown name or option; [`DelayError::Turns`] for a window beyond the resolution of the frequencies;
    /// [`crate::error::Error::Stopped`].
    pub fn run(&self) -> Result<Report> {
        let response = &self.response;
        let (first, last) = ends(response);
        let unambiguous_s = response.unambiguous_s();
        let max_delay_s = match self.max_delay_s {
            Some(seconds)
                if !(seconds.is_finite() && seconds > 0.0 && seconds <= unambiguous_s) =>
            {
                return Err(DelayError::Turns { seconds, unambiguous_s }.into());
            }
            Some(seconds) => seconds,
            None => (PERIODS * std::f64::consts::TAU / last).min(0.5 * unambiguous_s),
        };
        let search = ResponseSearch { max_delay_s, stop: self.stop.clone() };
        let mut answers = Vec::new();
        for (method, estimator) in self.chosen()? {
            self.stop.check()?;
            let clock = Instant::now();
            let estimate = usable(estimator.estimate(response, &search))?;
            answers.push((method, estimate, clock.elapsed().as_secs_f64()));
        }
        let verdict = verdict(&answers, max_delay_s, last / first);
        // The resolution of printed values.
        let half = verdict.ci95_s.map_or(f64::INFINITY, |[from, to]| 0.5 * (to - from)).max(1e-9);
        let estimates =
            answers.iter().map(|(m, e, time_s)| Estimate::of_response(m, e, *time_s)).collect();
        let pair = Pair::new([&self.channels[0], &self.channels[1]], estimates, verdict);
        let searched = Searched::Frequencies {
            count: response.omega_rad_s().len(),
            band_hz: [first, last].map(|w| w / std::f64::consts::TAU),
            unambiguous_s,
            notes: response.notes().to_vec(),
        };
        Ok(Report {
            format: FORMAT,
            log: response.source().to_owned(),
            sample_time_s: half.min(std::f64::consts::PI / last),
            max_delay_s,
            pairs: vec![pair],
            searched,
        })
    }

    fn chosen(&self) -> Result<Vec<(&'static ResponseMethod, Box<dyn ResponseEstimator>)>> {
        let names = RESPONSE_METHODS.iter().map(|m| m.entry.name);
        known("method for frequency responses", names, &self.methods, &self.options)?;
        let wanted =
            |m: &&ResponseMethod| self.methods.iter().any(|n| n == "all" || n == m.entry.name);
        let with_options = |m: &'static ResponseMethod| {
            Ok((m, m.entry.with(options_of(&self.options, m.entry.name))?))
        };
        RESPONSE_METHODS.iter().filter(wanted).map(with_options).collect()
    }
}

/// The verdict is the first method of the list with a delay that its own residuals do not contradict; methods whose interval holds it agree. Disagreement is
/// reported, and the first method's estimate stays: only that method weighs the number of poles.
pub(super) fn verdict(
    answers: &[(&ResponseMethod, DelayEstimate, f64)],
    max_delay_s: f64,
    band: f64,
) -> Verdict {
    let found: Vec<(&str, &DelayEstimate)> = answers
        .iter()
        .filter(|(_, e, _)| e.outcome == Outcome::Found)
        .map(|(m, e, _)| (m.entry.name, e))
        .collect();
    let Some((name, chosen)) = found.iter().find(|(_, e)| !e.contradicted).or(found.first()) else {
        let said: Vec<String> = answers.iter().map(|(m, e, _)| silent(m, e)).collect();
        return Verdict::none(format!("no method found a trusted delay: {}", said.join("; ")));
    };
    let (Some(delay_s), Some(ci95_s)) = (chosen.delay_s, chosen.ci95_s) else {
        return Verdict::none("no method found a trusted delay".to_owned());
    };
    if ci95_s[1] - ci95_s[0] > 0.5 * max_delay_s {
        return Verdict::none(format!(
            "delays from {:.4} to {:.4} s fit about alike: measure at higher frequencies, or closer together",
            ci95_s[0], ci95_s[1]
        ));
    }
    let mut grounds = Grounds { agree: vec![(*name).to_owned()], ..Grounds::default() };
    for (other, e) in found.iter().filter(|(other, e)| other != name && !e.contradicted) {
        let Some(at) = e.delay_s else { continue };
        if e.ci95_s.is_some_and(|[from, to]| from <= ci95_s[1] && to >= ci95_s[0]) {
            grounds.agree.push((*other).to_owned());
        } else {
            grounds.differ.push(((*other).to_owned(), at));
        }
    }
    let doubts = [
        (chosen.contradicted, "its residuals contradict its model: treat the number as a guess"),
        (
            band < NARROW,
            "the band is less than two octaves wide: lag of poles outside it looks like delay",
        ),
    ];
    grounds.doubts.extend(doubts.iter().filter(|(holds, _)| *holds).map(|(_, d)| (*d).to_owned()));
    Verdict {
        delay_s: Some(delay_s),
        ci95_s: Some(ci95_s),
        why: why(name, &grounds),
        method: Some((*name).to_owned()),
        grounds,
    }
}

/// The note of a method without a delay.
fn silent(method: &ResponseMethod, estimate: &DelayEstimate) -> String {
    let note = estimate.note.as_deref().map_or_else(String::new, |n| format!(" ({n})"));
    format!("{} says {}{note}", method.entry.name, estimate.outcome.name().replace('_', " "))
}

/// The selected method, those that agree or disagree, and the reservations.
fn why(name: &str, grounds: &Grounds) -> String {
    let mut why = match grounds.agree.get(1..) {
        Some(others) if !others.is_empty() => {
            format!("{name} says so, and {} agrees with it", others.join(", "))
        }
        _ => format!("{name} alone"),
    };
    let differ = grounds.differ.iter().map(|(other, at)| format!("; {other} {at:.4} s"));
    why.extend(differ.chain(grounds.doubts.iter().map(|doubt| format!("; {doubt}"))));
    why
}
