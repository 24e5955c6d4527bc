//! Areas and moments of the estimated impulse response, one method each.
//!
//! Equation: y(t) = Σ hᵢ·u(t − i) + e(t), h by least squares.

use super::reading::{Area, BEYOND, Lags, Reading, SIGNIFICANT, answer, area, propagated};
use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, impulse_response, options};
use crate::method::{Condition, Information, Law, Method, method_line};
use deadtime_identify::Fir;

/// A method: its options, its line in the list, and both readings of a response.
macro_rules! read {
    (
        $(#[$doc:meta])*
        pub struct $options:ident;
        $line:ident: Method { $($claim:tt)* } as ($name:literal, $summary:literal, $same:ident),
        lags: $lags:expr,
        readings: $readings:ident,
        none: $none:literal,
    ) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $options {
            /// Coefficients of the impulse response; default 71, more where the search window needs them.
            pub taps: usize,
        }

        impl Default for $options {
            fn default() -> Self {
                Self { taps: 71 }
            }
        }

        pub(crate) const $line: Method = Method {
            blind_to: "the order of the plant, which it takes for granted; oscillation; feedback",
            $($claim)*
            ..method_line!($name, $summary, $options, Area)
        };

        impl PairMethod for $options {
            fn check(&self) -> Result<(), DelayError> {
                options($name, [("taps", self.taps as f64, self.taps >= 1, "1 or more")])
            }

            fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
                let (fir, gain) = pulse_response($name, self.taps, pair)?;
                let Some(readings) = $readings(&fir, gain) else {
                    return Err(NoDelay::new(Outcome::Singular, $none));
                };
                answer($lags, readings, pair)
            }
        }
    };
}

/// The requirements on a plant of one lag.
const ONE_LAG: &str =
    "a plant of one lag, a response that dies out within the taps, an input that excites them all";

read! {
    /// The dead time of one lag from two areas of the estimated step response.
    ///
    /// Equation: K·e^(−Ls)/(1 + sT): L = A₀/K − e·A₁/K, A₀ = ∫(K − s) dt, A₁ = ∫₀^(A₀/K) s dt. Here s is the running sum of the least-squares impulse response.
    ///
    /// Inputs: u, y on one even grid. Output: seconds, positive = y lags u; the raw value is the continuous L of the equation.
    ///
    /// Assumes: a plant of dead time and one lag; a response that dies out within `taps` samples; white noise.
    /// Resolution and cost: fractions of a sample, if the plant is as assumed; O(N·taps).
    /// Fails when: the plant is of another order or oscillates: two equal lags T bias the delay by +0.53·T, more lags by more. Noise may hide the gain at
    /// frequency 0, or put the average residence time outside the response (`singular`). An input may not excite every coefficient (`not_rich_enough`). The
    /// interval covers plants of one lag to two equal lags, and none beyond them.
    /// Source: Åström and Hägglund (1995), "PID Controllers: Theory, Design, and Tuning", 2nd ed., section 2.4. Björklund (2003), LiU-TEK-LIC-2003:60, class 3,
    /// reports a mean RMS error of 3.1 to 3.4 samples for `area2`. The thesis does not define how its `area1` to `area3` differ and gives their parameters
    /// only. The thesis scored `area2` on random inputs too, so `area2` is taken to be the variant that needs no step.
    ///
    /// # Example
    /// ```
    /// use deadtime_delay::{Area2, DelayEstimator, Experiment, Search};
    /// use deadtime_signal::{Excitation, excitation::Rbs};
    /// use deadtime_signal::time::SampleTime;
    /// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// let u = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
    /// let mut y = vec![0.0; 401];
    /// for t in 4..400 {
    ///     y[t + 1] = 0.8 * y[t] + 0.2 * u[t - 4];
    /// }
    /// y.pop();
    /// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
    /// let answer = Area2::default().estimate(&experiment, &Search::default())?;
    /// assert!((answer.delay_s.unwrap() - 0.4).abs() < 0.02);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub struct Area2;
    AREA2: Method {
        information: Information::Poles(1),
        tolerance: 2.0,
        withstands: &[Condition::MissingOutputs],
        needs: ONE_LAG,
        exempt: &[(Law::Exact, "it reads the response as that of one lag, which most plants are not")],
    } as ("area2", "dead time of one lag from areas of the estimated step response", Area2),
    lags: Lags::One,
    readings: by_areas,
    none: "noise puts the average residence time outside the response: the areas have no solution",
}

read! {
    /// The dead time of two equal lags from two areas of the estimated step response.
    ///
    /// Equation: K·e^(−Ls)/(1 + sT)²: L = A₀/K − (e²/2)·A₁/K, A₀ = ∫(K − s) dt, A₁ = ∫₀^(A₀/K) s dt. Here s is the running sum of the least-squares impulse
    /// response.
    ///
    /// Inputs: u, y on one even grid. Output: seconds, positive = y lags u; the raw value is the continuous L of the equation.
    ///
    /// Assumes: a plant of dead time and two equal lags; a response that dies out within `taps` samples; white noise.
    /// Resolution and cost: fractions of a sample, if the plant is as assumed; O(N·taps).
    /// Fails when: the plant is of another order or oscillates: one lag T biases the delay by −0.36·T, more than two lags bias it late. Noise may hide the gain
    /// at frequency 0, or put the average residence time outside the response (`singular`). An input may not excite every coefficient (`not_rich_enough`). The
    /// interval covers plants of one lag to two equal lags, and none beyond them.
    /// Source: Åström and Hägglund (1995), "PID Controllers: Theory, Design, and Tuning", 2nd ed., section 2.4 (its second three-parameter model). Björklund
    /// (2003), LiU-TEK-LIC-2003:60, class 3, reports a mean RMS error of 3.1 to 3.4 samples for `area2`. The thesis does not define how its `area1` to `area3`
    /// differ and gives their parameters only. `area3` is taken to be Åström and Hägglund's other model of three parameters K, L, T.
    ///
    /// # Example
    /// ```
    /// use deadtime_delay::{Area3, DelayEstimator, Experiment, Search};
    /// use deadtime_signal::{Excitation, excitation::Rbs};
    /// use deadtime_signal::time::SampleTime;
    /// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// let u = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
    /// let (p, a, mut y) = (0.8_f64, -0.8_f64.ln(), vec![0.0; 401]);
    /// for t in 5..400 {
    ///     // Two equal lags behind a hold and four samples of delay.
    ///     y[t + 1] = 2.0 * p * y[t] - p * p * y[t - 1] + (1.0 - p - a * p) * u[t - 4] + p * (p - 1.0 + a) * u[t - 5];
    /// }
    /// y.pop();
    /// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
    /// let answer = Area3::default().estimate(&experiment, &Search::default())?;
    /// assert!((answer.delay_s.unwrap() - 0.4).abs() < 0.02);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub struct Area3;
    AREA3: Method {
        information: Information::Poles(2),
        tolerance: 1.5,
        withstands: &[Condition::Dynamics, Condition::MissingOutputs],
        needs: "a plant of two equal lags, a response that dies out within the taps, an input that excites them all",
        exempt: &[(Law::Exact, "it reads the response as that of two equal lags, which most plants are not")],
    } as ("area3", "dead time of two equal lags from areas of the estimated step response", Area3),
    lags: Lags::Two,
    readings: by_areas,
    none: "noise puts the average residence time outside the response: the areas have no solution",
}

read! {
    /// The dead time of one lag from two moments of the estimated impulse response.
    ///
    /// Equation: K·e^(−Ls)/(1 + sT): L = μ − √v. Here μ = ∫t·h dt/K is the mean and v = ∫(t − μ)²·h dt/K the variance of the impulse response.
    ///
    /// Inputs: u, y on one even grid. Output: seconds, positive = y lags u; the raw value is the continuous L of the equation.
    ///
    /// The response to one held sample is the impulse response smeared over one sample. With its mean and variance, L = μ − ½ − √(v + ¼) samples is exact for
    /// one lag. For two equal lags of at least one sample, L = μ − ½ − √(2v + ½) holds within 0.2 samples.
    /// Assumes: a plant of dead time and one lag; a response that dies out within `taps` samples; white noise.
    /// Resolution and cost: fractions of a sample, if the plant is as assumed; O(N·taps).
    /// Fails when: the plant is of another order or oscillates (two equal lags T bias the delay by +0.59·T). Noise often hides the variance (`singular`: no
    /// real solution), because the variance weighs noise with time squared. Noise may also hide the gain at frequency 0 (`singular`). An input may not excite
    /// every coefficient (`not_rich_enough`). The interval covers plants of one lag to two equal lags, and none beyond them.
    /// Source: Åström and Hägglund (1995), "PID Controllers: Theory, Design, and Tuning", 2nd ed., section 2.4 (the method of moments). Björklund (2003),
    /// LiU-TEK-LIC-2003:60, class 3, calls it "not useful": more than 54 % failures. The thesis's choice of the moments and of the response's length is not
    /// known.
    pub struct Moment;
    MOMENT: Method {
        information: Information::Poles(1),
        tolerance: 2.0,
        withstands: &[Condition::MissingOutputs],
        needs: ONE_LAG,
        exempt: &[
            (Law::Exact, "it reads the response as that of one lag, which most plants are not"),
            (
                Law::Shift,
                "it weighs noise with the square of time: of records with 2 % of noise and 400 samples half have no real solution",
            ),
        ],
    } as ("moment", "dead time of one lag from mean and variance of the impulse response", Moment),
    lags: Lags::One,
    readings: by_moments,
    none: "the variance of the impulse response is negative or below the noise: the moments have no real solution",
}

/// The impulse response and its sum K.
fn pulse_response(
    name: &'static str,
    taps: usize,
    pair: &PairRecords,
) -> Result<(Fir, f64), NoDelay> {
    let taps = taps.max(pair.max_delay + BEYOND);
    pair.at_least(name, 2 * taps + 1, LengthRemedy::WindowOr("set fewer taps"))?;
    let fir = impulse_response(pair.records, taps)?;
    pair.visible()?;
    let gain = fir.coefficients.sum();
    let significant = gain.abs() > SIGNIFICANT * fir.covariance.sum().max(0.0).sqrt();
    if !significant {
        let note = "the gain at frequency 0, by which areas and moments are divided, does not exceed the noise";
        return Err(NoDelay::new(Outcome::Singular, note));
    }
    Ok((fir, gain))
}

/// Both readings of the areas of an impulse response; `None` where they have no solution.
pub(super) fn by_areas(fir: &Fir, gain: f64) -> Option<[Reading; 2]> {
    let h = &fir.coefficients;
    let mean = h.iter().enumerate().map(|(j, h)| j as f64 * h).sum::<f64>() / gain;
    let step: Vec<f64> = h
        .iter()
        .scan(0.0, |sum, h| {
            *sum += h;
            Some(*sum)
        })
        .collect();
    // Straight lines between the samples: half a sample less than the sum of K − s.
    let t_ar = mean - 0.5;
    let Area { a1, height, weights } = area(&step, gain, t_ar)?;
    // Σ wᵢ over i ≥ j: the contribution of impulse-response sample j to the area.
    let mut after = weights;
    for j in (0..after.len().saturating_sub(1)).rev() {
        after[j] += after[j + 1];
    }
    let reading = |lags: Lags| {
        let c = lags.of_area();
        let gradient: Vec<f64> = after
            .iter()
            .enumerate()
            .map(|(j, w)| ((1.0 - c * height) * (j as f64 - mean) - c * (w - a1)) / gain)
            .collect();
        Reading { delay: t_ar - c * a1, std: propagated(&gradient, &fir.covariance) }
    };
    let readings = [reading(Lags::One), reading(Lags::Two)];
    readings.iter().all(|r| r.delay.is_finite() && r.std.is_finite()).then_some(readings)
}

/// Variance that one lag behind a hold lacks. A pulse response (1 − p)·pⁱ has the mean 1/(1 − p) = ½ + √(v + ¼) beyond the delay.
const HOLD: f64 = 0.25;

/// Both readings of mean and variance; `None` where the variance is negative or not significant.
fn by_moments(fir: &Fir, gain: f64) -> Option<[Reading; 2]> {
    let about = |from: f64, power: i32| {
        fir.coefficients
            .iter()
            .enumerate()
            .map(|(j, h)| (j as f64 - from).powi(power) * h)
            .sum::<f64>()
            / gain
    };
    let mean = about(0.0, 1);
    let variance = about(mean, 2);
    let spread: Vec<f64> = (0..fir.coefficients.len())
        .map(|j| ((j as f64 - mean).powi(2) - variance) / gain)
        .collect();
    let significant = variance + HOLD > SIGNIFICANT * propagated(&spread, &fir.covariance);
    if !significant {
        return None;
    }
    let width = (variance + HOLD).sqrt();
    let reading = |times: f64| {
        let gradient: Vec<f64> = (0..fir.coefficients.len())
            .map(|j| j as f64 - mean)
            .map(|t| (t - 0.5 * times * (t * t - variance) / width) / gain)
            .collect();
        Reading { delay: mean - 0.5 - times * width, std: propagated(&gradient, &fir.covariance) }
    };
    let readings = [reading(1.0), reading(std::f64::consts::SQRT_2)];
    readings.iter().all(|r| r.delay.is_finite() && r.std.is_finite()).then_some(readings)
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;

    /// Sampled step responses of e^(−Ls)/(1 + sT)ⁿ by their closed forms.
    fn step(delay: f64, lag: f64, order: usize) -> Vec<f64> {
        (0..400)
            .map(|i| {
                let x = (i as f64 - delay) / lag;
                match order {
                    _ if x <= 0.0 => 0.0,
                    1 => 1.0 - (-x).exp(),
                    _ => 1.0 - (1.0 + x) * (-x).exp(),
                }
            })
            .collect()
    }

    fn fir(h: Vec<f64>) -> Fir {
        let n = h.len();
        Fir {
            coefficients: DVector::from_vec(h),
            covariance: DMatrix::identity(n, n) * 1e-24,
            variance: 1e-24,
            rows: 1000,
        }
    }

    fn of_step(step: &[f64]) -> Fir {
        fir((0..step.len()).map(|i| step[i] - if i > 0 { step[i - 1] } else { 0.0 }).collect())
    }

    #[test]
    fn each_reading_is_right_for_its_own_plant() {
        for (delay, lag) in [(4.0, 5.0), (9.3, 10.0), (0.0, 20.0), (17.0, 3.0)] {
            let one = by_areas(&of_step(&step(delay, lag, 1)), 1.0).unwrap()[0].delay;
            let two = by_areas(&of_step(&step(delay, lag, 2)), 1.0).unwrap()[1].delay;
            assert!(
                (one - delay).abs() < 0.1 && (two - delay).abs() < 0.1,
                "{delay} {lag}: {one} {two}"
            );
            let [early, late] =
                [1, 0].map(|k| by_areas(&of_step(&step(delay, lag, 2)), 1.0).unwrap()[k].delay);
            assert!(early < late, "one lag read into two is late");
        }
    }

    #[test]
    fn the_standard_deviation_is_that_of_the_difference_quotients() {
        type Readings = fn(&Fir, f64) -> Option<[Reading; 2]>;
        let falling = (0..40).map(|i| if i > 5 { 0.2 * 0.8_f64.powi(i - 6) } else { 0.0 });
        for (read, at) in [
            (by_areas as Readings, of_step(&step(4.2, 5.0, 1)[..60])),
            (by_moments, fir(falling.collect())),
        ] {
            let readings = |fir: &Fir| read(fir, fir.coefficients.sum()).unwrap();
            for k in 0..2 {
                let moved = |j: usize, h: f64| {
                    let mut other = at.clone();
                    other.coefficients[j] += h;
                    readings(&other)[k].delay
                };
                let squares: f64 = (0..at.coefficients.len())
                    .map(|j| ((moved(j, 1e-6) - moved(j, -1e-6)) / 2e-6).powi(2))
                    .sum();
                let std = readings(&at)[k].std;
                assert!((std / (1e-12 * squares.sqrt()) - 1.0).abs() < 1e-3, "{std}");
            }
        }
    }

    #[test]
    fn one_lag_behind_a_hold_is_read_exactly() {
        for (delay, lag) in [(4, 5.0_f64), (9, 10.0), (0, 2.0)] {
            let p = (-1.0 / lag).exp();
            let h = (0..400)
                .map(|i| if i > delay { (1.0 - p) * p.powi(i - delay - 1) } else { 0.0 })
                .collect();
            let found = by_moments(&fir(h), 1.0).unwrap()[0].delay;
            assert!((found - f64::from(delay)).abs() < 1e-9, "{delay} {lag}: {found}");
        }
    }

    #[test]
    fn a_negative_variance_has_no_reading() {
        assert!(by_moments(&fir(vec![-0.1, 0.0, 1.2, 0.0, -0.1]), 1.0).is_none());
    }
}
