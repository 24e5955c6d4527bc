//! The delay of the ARX model with the best prediction after a subspace model's noise filter has whitened the noise.
//!
//! Equation: C(q) = det(I − (A − KC)q⁻¹) of a state-space model in innovations form. τ̂ = Ts·argmin over nk of V(nk), A(q) y_F = B(q) u_F(t − nk) + e, y_F =
//! y/C, u_F = u/C.

use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, long_enough, noted, options};
use crate::method::{Condition, Information, Law, Method, method_line, plant_example};
use crate::posterior;
use deadtime_identify::{MAX_OE_ORDER, Record, Subspace, arx_scan, prefiltered};

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u.
///
/// Assumes: a linear plant and noise that a state-space model of the given order describes. The plant may be unstable and under feedback, if u is the received
/// plant input.
/// Resolution and cost: one sample; one triangular factor of the lagged data, O(N·past), and an ARX scan.
/// Fails when: the record is too short for the long predictor behind the subspace model. A first input coefficient that is small compared with the noise biases
/// the delay late. With too low an order (nb = 1) the poles represent the zeros. An all-pole model of order 10 can absorb some samples of delay on slow inputs.
/// The estimate is then off by samples, outside its interval. Examples: 3 samples on the roll rate of the demo's flight, a plant of three poles and two zeros.
/// Another: 4 samples on 1 000 000 samples of one lag without the limit `max_samples`. Björklund's subspace model (`n4sid`) includes the delay in its states.
/// Here the input is first shifted by the delay of an ARX scan, so that all states describe the dynamics. The predictor form is used, which feedback does not
/// bias. States that the data do not support are removed: on short records their poles and zeros make the noise filter ring. The long predictor's window is
/// also this program's choice.
/// Source: Björklund (2003), LiU-TEK-LIC-2003:60, section 6.5 (order 10, then ARX(10, 1): as good as `oestruc` at a fraction of its time). For the model Chiuso
/// (2007), doi:10.1016/j.automatica.2006.12.005. The source does not give the initial states of the filters; they start at rest here.
#[doc = plant_example!(Met1struc, 400, 0.8, 1e-12)]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Met1struc {
    /// Largest number of states of the subspace model; Schwarz's criterion selects the order. Default 10, which the source always uses.
    pub order: usize,
    /// Past samples in its predictor; default 20, twice the order.
    pub past: usize,
    /// Past outputs of the scanned model; default 10, as in the source.
    pub na: usize,
    /// Its input coefficients; default 1, as in the source.
    pub nb: usize,
    /// Longest part of a record that is used, samples; default 20 000, beyond which the noise filter's own error exceeds the noise.
    pub max_samples: usize,
}

impl Default for Met1struc {
    fn default() -> Self {
        Self { order: 10, past: 20, na: 10, nb: 1, max_samples: 20_000 }
    }
}

const NAME: &str = "met1struc";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    information: Information::Poles(2),
    withstands: &[
        Condition::UnstablePlant,
        Condition::Feedback,
        Condition::ColouredNoise,
        Condition::Dynamics,
    ],
    needs: "the input that the plant received; a record of at least some hundred samples",
    blind_to: "a plant's zeros, which its one input coefficient leaves to the poles: early or late by samples then",
    exempt: &[(
        Law::Exact,
        "with one input coefficient a plant's zeros are left to its poles: without noise that misfit decides, by a sample",
    )],
    ..method_line!(
        "met1struc",
        "best ARX model (10, 1) after whitening by the noise filter of a subspace model of order 10",
        Met1struc,
        Parametric
    )
};

impl PairMethod for Met1struc {
    fn check(&self) -> Result<(), DelayError> {
        let Self { order, past, nb, max_samples, .. } = *self;
        let rows = [
            ("order", order as f64, (1..=MAX_OE_ORDER).contains(&order), "from 1 to 16"),
            ("past", past as f64, (order..=1000).contains(&past), "from the order to 1000"),
            ("nb", nb as f64, nb >= 1, "1 or more"),
            ("max_samples", max_samples as f64, max_samples >= 1, "1 or more"),
        ];
        options(NAME, rows)
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let max_delay = pair.max_delay;
        let (records, used) = pair.heads(self.max_samples);
        let scanned = self.na.max(max_delay + self.nb - 1) + 2 * (self.na + self.nb);
        let subspace = Subspace { order: self.order, past: self.past, direct: false };
        let needed = scanned.max(max_delay + self.past + subspace.rows_needed());
        let got = pair.experiment.longest().min(self.max_samples);
        long_enough(NAME, needed, got, LengthRemedy::WindowOr("set a shorter past"))?;
        let cut = pair.with(&records);
        cut.measured_throughout("missing output samples: the noise filter needs every one")?;
        // The filter is fitted to the input: on noise alone it biases the subsequent scan.
        cut.visible()?;
        let rough = arx_scan(&records, self.na, self.nb, max_delay);
        let first = posterior::smallest(&rough.loss);
        let lead = first.unwrap_or(0).saturating_sub(1);
        let moved: Vec<Record> = (records.iter().filter(|r| r.len() > lead))
            .map(|r| Record::new(r.u[..r.len() - lead].to_vec(), r.y[lead..r.len()].to_vec()))
            .collect();
        let model = Subspace { direct: first == Some(0), ..subspace }.fit(&moved);
        // Rounding needs no whitening.
        let exact = |loss: f64| loss <= posterior::ROUNDING * rough.power;
        let noise =
            model.and_then(|m| if exact(m.loss) { Some(Vec::new()) } else { m.noise_polynomial() });
        let Some(noise) = noise else {
            let note = "no subspace model: the numbers overflow or say nothing; scale the channels";
            return Err(NoDelay::new(Outcome::Singular, note));
        };
        let filtered: Vec<Record> = records.iter().map(|r| prefiltered(r, &noise)).collect();
        let scan = arx_scan(&filtered, self.na, self.nb, max_delay);
        noted(super::arxstruc::answer(&scan, self.nb, pair), used)
    }
}
