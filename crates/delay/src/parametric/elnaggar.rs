//! The delay at which the output's increments correlate most with the input.
//!
//! Equation: E(d) = Σ Δy(t)·u(t − d), Δy(t) = y(t) − y(t − 1); τ̂ = Ts·argmax over d of E(d)²/Σ u(t − d)². The maximum equals the least Σ (Δy(t) − b·u(t − d))²
//! over b and d.

use crate::error::LengthRemedy;
use crate::estimate::DelayEstimate;
use crate::estimator::{NoDelay, PairMethod, PairRecords};
use crate::method::{Condition, Information, Law, Method, method_line, plant_example};
use crate::posterior;
use deadtime_identify::{Record, arx_scan};

/// The criterion to minimise or maximise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cost {
    /// The products of output increments with the input: needs no model.
    #[default]
    Products,
    /// The loss of a first-order model with one regressor of variable delay, y(t) = a·y(t − 1) + b·u(t − d) + e(t).
    Regression,
}

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u.
///
/// Assumes: an input about as white as a random binary signal, and no feedback. The plant's response rises fastest at its first sample, as with one lag, and
/// with most pairs of lags.
/// Resolution and cost: one sample; O(N·delays), one product per sample and delay.
/// Fails when: the response rises faster later (three lags or more, oscillating plants): biased late. With a slow input its own correlation smears the products
/// over equally many samples. The interval therefore reaches back over all delays whose products are significant in one run with the largest.
/// Source: Elnaggar, Dumont and Elshafei (1989), "Recursive estimation for system of unknown delay", 28th IEEE CDC, doi:10.1109/CDC.1989.70485. Also their "New
/// method for delay estimation", 29th IEEE CDC (1990). Read through Björklund (2003), LiU-TEK-LIC-2003:60, class 2b, and O'Dwyer's classification of 1999. The
/// papers were not available, and the descriptions leave three points open. The open points are: input or increments of the input in the products; the
/// forgetting of the recursive form; the treatment of the sign. With increments of a white input the sample before the response has nearly as large a product.
/// Here: the input without its mean, equal weights for all samples, the largest square. The sources give no uncertainty; the interval is this program's.
#[doc = plant_example!(Elnaggar, 400, 0.8, 1e-12)]
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Elnaggar {
    /// The criterion; default the products.
    pub cost: Cost,
}

const NAME: &str = "elnaggar";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    information: Information::Response,
    withstands: &[Condition::ColouredNoise, Condition::Dynamics, Condition::MissingOutputs],
    needs: "a white input, a response that rises fastest at its start",
    blind_to: "the start of a response that rises faster later; slow inputs; feedback",
    exempt: &[(
        Law::Exact,
        "it takes the steepest rise of the response for its start: of oscillating plants that is a later sample",
    )],
    ..method_line!(
        "elnaggar",
        "delay at which increments of the output go with the input: the cheapest of all, for rich inputs and simple lags",
        Elnaggar,
        Parametric
    )
};

impl PairMethod for Elnaggar {
    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let &PairRecords { records, max_delay, .. } = pair;
        let delays = max_delay + 1;
        pair.at_least(NAME, delays + ROWS, LengthRemedy::Window)?;
        pair.visible()?;
        // Computed twice for `scripts/bench-gate --self-check`, which must detect it; no result changes.
        #[cfg(deadtime_slowdown)]
        if self.cost == Cost::Products {
            std::hint::black_box(products(std::hint::black_box(records), max_delay));
        }
        let scores = match self.cost {
            Cost::Products => products(records, max_delay),
            Cost::Regression => regression(records, max_delay),
        };
        let posterior = posterior::posterior(&scores.losses, scores.power, scores.rows)
            .ok_or_else(NoDelay::overflow)?;
        if posterior.is_flat() {
            return Err(NoDelay::flat(posterior.set, delays));
        }
        let best = posterior.best;
        let from = scores.run(best);
        let (raw, from) = (best as f64, (from as f64).min(posterior.ends[0]));
        let interval = posterior::first_coefficient(from, posterior.ends[1], pair.bias);
        let note = (raw - from > 1.5).then(|| {
            format!("the products stand out from nk = {from} on: the response may begin there")
        });
        let std = posterior.std.max((interval[1] - interval[0]) * posterior::RESOLUTION.sqrt());
        Ok(pair.counted(raw, std, interval).noting(note))
    }
}

/// Rows that the longest delay must leave.
const ROWS: usize = 20;

/// Standard deviations from which a product is significant.
const STANDS_OUT: f64 = 3.0;

/// Losses and coefficients of every delay.
struct Scores {
    /// Σ e²/rows.
    losses: Vec<f64>,
    /// The coefficient of u(t − d) in units of its own standard deviation.
    ratios: Vec<f64>,
    power: f64,
    rows: f64,
}

impl Scores {
    /// The first delay of the run that ends at `best` with only significant coefficients of the same sign.
    fn run(&self, best: usize) -> usize {
        let sign = self.ratios[best].signum();
        (0..best).rev().take_while(|&d| sign * self.ratios[d] > STANDS_OUT).last().unwrap_or(best)
    }
}

/// Σ (Δy(t) − b·u(t − d))² for every d, over the rows of the longest delay.
fn products(records: &[Record], max_delay: usize) -> Scores {
    let delays = max_delay + 1;
    let mean = records.iter().flat_map(|r| r.u.iter()).sum::<f64>()
        / records.iter().map(Record::len).sum::<usize>().max(1) as f64;
    let (mut cross, mut energy, mut power, mut rows) =
        (vec![0.0; delays], vec![0.0; delays], 0.0, 0.0);
    for record in records {
        let there = |t: usize| record.present.as_ref().is_none_or(|p| p[t]);
        // Newest first, so that the inputs behind a row are in the order of the delays.
        let n = record.len();
        let past: Vec<f64> = record.u[..n].iter().rev().map(|u| u - mean).collect();
        for t in (max_delay.max(1)..n).filter(|&t| there(t) && there(t - 1)) {
            let increment = record.y[t] - record.y[t - 1];
            power += increment * increment;
            rows += 1.0;
            for ((u, c), e) in past[n - 1 - t..].iter().zip(&mut cross).zip(&mut energy) {
                *c += increment * u;
                *e += u * u;
            }
        }
    }
    let rows_at_least = f64::max(rows, 1.0);
    let loss = |(c, e): (&f64, &f64)| {
        if *e > 0.0 { (power - c * c / e).max(0.0) / rows_at_least } else { f64::NAN }
    };
    let losses: Vec<f64> = cross.iter().zip(&energy).map(loss).collect();
    let least = losses.iter().copied().filter(|v| v.is_finite()).fold(f64::INFINITY, f64::min);
    let ratio = |(c, e): (&f64, &f64)| {
        if *e > 0.0 { c / (e * least).max(f64::MIN_POSITIVE).sqrt() } else { 0.0 }
    };
    let ratios = cross.iter().zip(&energy).map(ratio).collect();
    Scores { losses, ratios, power: power / rows_at_least, rows: rows_at_least }
}

/// The losses of first-order models with one input coefficient.
fn regression(records: &[Record], max_delay: usize) -> Scores {
    let scan = arx_scan(records, 1, 1, max_delay);
    let rows = scan.rows.max(1) as f64;
    let least = scan
        .loss
        .iter()
        .copied()
        .filter(|v| v.is_finite())
        .fold(f64::INFINITY, f64::min)
        .max(f64::MIN_POSITIVE);
    let gain = |loss: &f64| (rows * (scan.loss_without_input - loss).max(0.0) / least).sqrt();
    let ratios = scan
        .loss
        .iter()
        .zip(&scan.coefficients)
        .map(|(loss, c)| gain(loss) * c[1].signum())
        .collect();
    Scores { losses: scan.loss, ratios, power: scan.power, rows }
}
