//! The delay of the refined instrumental-variable model with the smallest innovations.
//!
//! Equation: τ̂ = Ts·argmin over nk of V(nk), V = Σ(D v)²/N, v = y − B(q)/F(q) u(t − nk). D is an autoregression that whitens v. F and B solve Σ ζ(y_f − φᵀθ) =
//! 0 with φ = (−y_f(t − 1) …, u_f(t − nk) …). ζ is the same of the simulated output; all signals are filtered by D/F.

use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, long_enough, options, seen};
use crate::method::{Condition, Information, Law, Method, Start, method_line, plant_example};
use crate::posterior;
use deadtime_identify::{MAX_OE_ORDER, RefinedIv};

/// Inputs: u, y on one even grid, without missing samples. Output: seconds, positive = y lags u.
///
/// Assumes: a stable plant in open loop that rests at the start; noise of any colour that an autoregression describes, independent of the input.
/// Resolution and cost: one sample; about ten rounds of ten filter passes per delay.
/// Fails when: noise and input are correlated, as under feedback (biased: the simulated output is then no instrument). The mirrored poles of an unstable plant
/// do not converge (`not_converged`). B/F may have too few coefficients for a fast input. MATLAB's `ivstruc` solves once per delay with fixed instruments, a
/// high-order ARX model's simulation, and compares simulation errors. The instrumental-variable solution does not minimise these errors, and coloured noise
/// makes them poor evidence. Here each delay has its own refined solution, and errors are whitened before they are compared.
/// Source: Young (2011), "Recursive Estimation and Time-Series Analysis", 2nd ed., chapter 7, doi:10.1007/978-3-642-21981-8. Ljung (1999), "System
/// Identification", 2nd ed., section 7.6. MATLAB `ivstruc`. The sources do not treat unstable rounds (mirrored here) or rounds that do not converge (here the
/// round with the smallest loss is used). The noise order is open, too.
#[doc = plant_example!(Ivstruc, 300, 0.8, 1e-12)]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ivstruc {
    /// Numerator coefficients; default 1, as for `oestruc`.
    pub nb: usize,
    /// Poles of the plant; default 2, as for `oestruc`.
    pub nf: usize,
    /// Poles of the noise; default 4, which also whitens the residual of two plant poles.
    pub noise: usize,
    /// Longest part of a record that is used, samples; default 20 000: every round filters every signal anew.
    pub max_samples: usize,
}

impl Default for Ivstruc {
    fn default() -> Self {
        Self { nb: 1, nf: 2, noise: 4, max_samples: 20_000 }
    }
}

const NAME: &str = "ivstruc";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    start: Start::Rest,
    information: Information::Poles(2),
    withstands: &[Condition::ColouredNoise, Condition::Dynamics],
    needs: "open loop, a stable plant of low order that rests at the start, no missing sample",
    blind_to: "fractions of a sample; what an unstable plant or feedback does",
    exempt: &[(
        Law::Exact,
        "rounds need not settle where two poles and one coefficient are too few and no noise hides it: not_converged, seldom",
    )],
    ..method_line!(
        "ivstruc",
        "best model B/F by refined instrumental variables over all delays (nb 1, nf 2, noise AR 4): open loop, coloured noise",
        Ivstruc,
        Parametric
    )
};

impl PairMethod for Ivstruc {
    fn check(&self) -> Result<(), DelayError> {
        let Self { nb, nf, noise, max_samples } = *self;
        let rows = [
            ("nb", nb as f64, (1..=MAX_OE_ORDER).contains(&nb), "from 1 to 16"),
            ("nf", nf as f64, nf <= MAX_OE_ORDER, "at most 16"),
            ("noise", noise as f64, noise <= 100, "at most 100"),
            ("max_samples", max_samples as f64, max_samples >= 1, "1 or more"),
        ];
        options(NAME, rows)
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let parameters = self.nb + self.nf;
        let needed = pair.max_delay + self.nb + 3 * (parameters + self.noise);
        let got = pair.experiment.longest().min(self.max_samples);
        long_enough(NAME, needed, got, LengthRemedy::Window)?;
        pair.measured_throughout(
            "missing output samples: the instruments' filters need every one",
        )?;
        let (records, used) = pair.heads(self.max_samples);
        let orders = RefinedIv { nb: self.nb, nf: self.nf, noise: self.noise };
        let fits = orders.scan_until(&records, pair.max_delay, pair.stop);
        let losses: Vec<f64> =
            fits.iter().map(|f| f.as_ref().map_or(f64::NAN, |f| f.loss)).collect();
        let power = deadtime_identify::power(&records);
        let rows = records.iter().map(|r| r.len().saturating_sub(self.noise)).sum::<usize>() as f64;
        let (Some(posterior), Some(without)) =
            (posterior::posterior(&losses, power, rows), orders.loss_without_input(&records))
        else {
            return Err(NoDelay::overflow());
        };
        let best = posterior.best;
        let delays = pair.max_delay + 1;
        let gain = rows * (without / losses[best].max(f64::MIN_POSITIVE)).ln();
        // A pole pair may converge to any of N/2 frequencies, where the delay is only a phase; this adds to the number of tests.
        let tried = delays + if self.nf >= 2 { (rows / 2.0) as usize } else { 0 };
        seen(posterior::unseen_at(gain, parameters, tried))?;
        // A noise model of few poles takes slow or jumping noise for a response. The many poles of the ARX model must detect the input, too.
        let exact = losses[best] <= posterior::ROUNDING * power;
        if !exact {
            pair.with(&records).visible()?;
        }
        // The noise model explains data that no delay of the window explains, and the losses then nearly agree. Half of the delays is enough for `flat`.
        if posterior.set > delays / 2 || posterior.ties > 1 {
            return Err(NoDelay::flat(posterior.set.max(posterior.ties), delays));
        }
        // A loss at rounding level changes with rounding between rounds.
        if let Some(fit) = fits[best].as_ref().filter(|f| !f.converged && !exact) {
            let note = format!(
                "the rounds did not settle at nk = {best}, poles at |z| up to {:.4}: an unstable plant, feedback, or too small a model",
                deadtime_identify::largest_pole(&fit.f)
            );
            return Err(NoDelay::new(Outcome::NotConverged, note));
        }
        Ok(pair.most_probable(&posterior).noting(used))
    }
}
