//! The delay of the all-pass part of a Laguerre model.
//!
//! Equation: y(t) = Σ cₖ Lₖ(q) u(t) + e(t), Lₖ(z) = √(1 − a²)/(z − a)·wᵏ⁻¹ with w = (1 − az)/(z − a). The map w takes the outside of the unit circle to its
//! inside. At ω = 0 it delays by (1 + a)/(1 − a) samples. The zeros wᵢ of Σ cₖwᵏ⁻¹ are those of the model. Hence τ̂ = 1 + (1 + a)/(1 − a)·Σ Re (1 + wᵢ)/(1 −
//! wᵢ) samples over |wᵢ| < 1. The leading 1 belongs to 1/(z − a).

use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, long_enough, noted, options};
use crate::frequency::all_pass::all_pass;
use crate::method::{Condition, Information, Law, Method, Start, method_line, plant_example};
use deadtime_identify::{Laguerre, Record, laguerre};
use deadtime_signal::stats;

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u; the raw value includes the sample of the hold.
///
/// Assumes: a stable plant in open loop that rests at the start, without zeros outside the unit circle; white noise; a gain at frequency 0.
/// Resolution and cost: ten terms approximate a delay of 10 samples within 0.5 samples, one of 35 samples within 2. O(N·order²) for each tested pole.
/// Fails when: the delay is long compared with order·(1 + a)/(1 − a) samples: the series residual passes for noise (wide interval). One real pole fits a
/// resonant plant poorly. A gain at frequency 0 that is small compared with the noise puts zeros near z = 1 (excluded with a note, or `flat`). An input may
/// excite too little (`not_rich_enough`). The interval includes the median disagreement between series of other poles that fit about equally well; it measures
/// the truncation error.
/// Source: Wahlberg (1991), IEEE Trans. Automat. Contr. 36(5), 551-562, for the series. For the delay Isaksson, Horch and Dumont (2001), Proc. ACC, 3280-3285,
/// and Björklund and Ljung (2009), Automatica 45(10), 2467-2470 (10 filters with the pole 0.8 there). Björklund's `lagudap2` (2003, LiU-TEK-LIC-2003:60) may
/// choose the pole otherwise; here the best-fitting one of twelve is used. The head of `all_pass` describes the guard against zeros near 1.
#[doc = plant_example!(Lagudap, 400, 0.8, 0.05)]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Lagudap {
    /// Filters; default `None`: one for each delay searched, at least 10. The published 10 represent delays of up to ten samples.
    pub order: Option<usize>,
    /// The pole a, between 0 and 1; default `None`: the best-fitting one of twelve from 0 to 0.97.
    pub pole: Option<f64>,
    /// Longest part of a record that is used, samples; default 100 000, beyond which the fit changes little.
    pub max_samples: usize,
}

impl Default for Lagudap {
    fn default() -> Self {
        Self { order: None, pole: None, max_samples: 100_000 }
    }
}

const NAME: &str = "lagudap";

/// Filters for the shortest search window; the published number.
const LEAST: usize = 10;

/// Filters beyond the longest delay, for the response itself.
const BEYOND: usize = 5;

/// Tested poles.
const POLES: [f64; 12] = [0.0, 0.2, 0.35, 0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9, 0.94, 0.97];

/// Losses within this factor are equivalent: the factor is below the step between neighbouring poles where the series is good.
const ALIKE: f64 = 2.0;

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    start: Start::Rest,
    information: Information::Response,
    tolerance: 2.5,
    withstands: &[Condition::Dynamics, Condition::MissingOutputs],
    needs: "open loop, a stable plant without resonance that rests at the start, a gain at frequency 0",
    blind_to: "zeros of the plant outside the unit circle, which it takes for delay; feedback",
    exempt: &[(Law::Exact, "a series cut off after some terms only comes near a delay")],
    ..method_line!(
        "lagudap",
        "delay of the all-pass part of a Laguerre model, by its zeros",
        Lagudap,
        Laguerre
    )
};

impl PairMethod for Lagudap {
    fn check(&self) -> Result<(), DelayError> {
        let Self { order, pole, max_samples } = *self;
        let pole_ok = pole.is_none_or(|a| (0.0..1.0).contains(&a));
        let rows = [
            ("order", order.unwrap_or(LEAST) as f64, order.is_none_or(|n| n >= 2), "2 or more"),
            ("pole", pole.unwrap_or_default(), pole_ok, "0 or more and below 1"),
            ("max_samples", max_samples as f64, max_samples >= 1, "1 or more"),
        ];
        options(NAME, rows)
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let &PairRecords { records, max_delay, experiment, .. } = pair;
        let order = self.order.unwrap_or(LEAST.max(max_delay + BEYOND));
        let got = experiment.longest().min(self.max_samples);
        let remedy = LengthRemedy::WindowOr("set a smaller order or a larger max_samples");
        long_enough(NAME, max_delay + 4 * order, got, remedy)?;
        let cut: Vec<Record> = records.iter().map(|r| r.head(self.max_samples)).collect();
        // A series longer than half the record would be fitted to noise.
        let lasts = |a: &f64| order as f64 * (1.0 + a) <= 0.5 * got as f64 * (1.0 - a);
        let poles: Vec<f64> =
            self.pole.map_or_else(|| POLES.into_iter().filter(lasts).collect(), |a| vec![a]);
        let mut fits: Vec<Laguerre> =
            poles.iter().filter_map(|&a| laguerre(&cut, a, order)).collect();
        fits.sort_by(|a, b| a.loss.total_cmp(&b.loss));
        let Some(best) = fits.first() else {
            let note = "the input excites too few of the filters";
            return Err(NoDelay::new(Outcome::NotRichEnough, note));
        };
        pair.with(&cut).visible()?;
        let read = |fit: &Laguerre| {
            let scale = (1.0 + fit.pole) / (1.0 - fit.pole);
            let longest = max_delay.max(1) as f64 / scale;
            Some(all_pass(fit.c.as_slice(), [&fit.covariance; 2], longest)?.scaled(scale, 1.0, 0.0))
        };
        let Some(found) = read(best) else {
            let note = "the series has no distinguishable zeros";
            return Err(NoDelay::new(Outcome::Singular, note));
        };
        let apart: Vec<f64> = fits[1..]
            .iter()
            .take_while(|f| f.loss <= ALIKE * best.loss)
            .filter_map(read)
            .map(|r| (r.raw - found.raw).abs())
            .collect();
        let spread = stats::upper_median(apart).unwrap_or(0.0);
        let note = (experiment.longest() > self.max_samples)
            .then(|| format!("used the first {} samples", self.max_samples));
        noted(found.scaled(1.0, 0.0, spread).answer(pair), note)
    }
}
