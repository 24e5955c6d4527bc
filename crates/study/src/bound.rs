//! The Cramér-Rao bound of a record: delay, gain and poles unknown, the start at rest, the zeros known.
//!
//! Source: Kay (1993), "Fundamentals of Statistical Signal Processing: Estimation Theory", section 3.7; derivatives of the response by central differences.
//! At a delay of whole samples behind a hold the response has a kink in the delay: the difference across it is taken.

use nalgebra::DMatrix;

use super::feedback::filtered;
use super::plan::Colour;
use deadtime_delay::bound::joint;
use deadtime_model::simulate::{Options, Prehistory, lsim};
use deadtime_model::{Continuous, StateSpace, TransferFunction};
use deadtime_signal::time::SampleTime;

/// Share of a coefficient, or samples of delay, by which a difference is taken: the error of the difference is its square.
const STEP: f64 = 1e-5;
/// Number of poles above which no bound is given: most of them are indistinguishable, and none of the methods fits as many.
const MOST_POLES: usize = 4;

/// The least standard deviation of an unbiased estimate of the delay, samples, of one output of a plant of one input.
///
/// `None` where it is unknown: several inputs, many or unstable poles, no noise, or indistinguishable parameters.
pub(super) fn bound_samples(
    plant: &StateSpace<Continuous>,
    output: usize,
    u: &[Vec<f64>],
    delay_s: f64,
    sample_time: SampleTime,
    noise_std: f64,
    colour: &Colour,
) -> Option<f64> {
    let [u] = u else { return None };
    if plant.order() > MOST_POLES || !plant.is_stable() {
        return None;
    }
    let transfer = plant.transfer_function(output, 0).ok()?;
    let (numerator, denominator) = (transfer.numerator(), transfer.denominator());
    let drive = DMatrix::from_column_slice(u.len(), 1, u);
    let respond = |denominator: &[f64], delay_s: f64| -> Option<Vec<f64>> {
        let model =
            TransferFunction::from_polynomials(&numerator, denominator, delay_s, Continuous)
                .ok()?
                .to_state_space()
                .ok()?;
        let options = Options { prehistory: Prehistory::Rest, ..Options::default() };
        Some(
            lsim(&model, &drive, sample_time, &options).ok()?.y.column(0).iter().copied().collect(),
        )
    };
    // The noise is made white by A/C, and the derivatives with it.
    let leading = |c: &[f64]| [1.0].into_iter().chain(c.iter().copied()).collect::<Vec<f64>>();
    let whiten = |x: &[f64]| filtered(&leading(&colour.ar), &leading(&colour.ma), x);
    let slope = |above: Vec<f64>, below: Vec<f64>, step: f64| {
        let difference: Vec<f64> = above.iter().zip(&below).map(|(a, b)| (a - b) / step).collect();
        whiten(&difference)
    };
    let step_s = sample_time.to_seconds(STEP);
    let below_s = (delay_s - step_s).max(0.0);
    let by_delay = slope(
        respond(&denominator, delay_s + step_s)?,
        respond(&denominator, below_s)?,
        (delay_s + step_s - below_s) / sample_time.seconds(),
    );
    let mut others = vec![whiten(&respond(&denominator, delay_s)?)];
    for at in 1..denominator.len() {
        let moved = |factor: f64| {
            let mut all = denominator.clone();
            all[at] *= factor;
            respond(&all, delay_s)
        };
        others.push(slope(moved(1.0 + STEP)?, moved(1.0 - STEP)?, 2.0 * STEP));
    }
    joint(&by_delay, &others, noise_std).filter(|b| b.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_delay::ProcessModel;
    use deadtime_signal::Excitation;
    use deadtime_signal::excitation::Rbs;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    #[test]
    fn differences_agree_with_the_derivatives_of_a_process_model() {
        let ts = SampleTime::new(1.0).unwrap();
        let u = Rbs::default().generate(500, &mut ChaCha8Rng::seed_from_u64(3)).unwrap();
        for (lags, delay_s) in [(vec![10.0], 9.3), (vec![10.0, 1.0], 9.7), (vec![5.0], 2.5)] {
            let model = ProcessModel { gain: 1.0, lags_s: lags.clone(), zero_s: None, delay_s };
            let slopes = model.slopes(&u, ts).unwrap();
            let exact = joint(&slopes.by_delay, &slopes.by_others, 0.1).unwrap();
            let denominator = lags.iter().fold(vec![1.0], |d, lag| {
                d.iter()
                    .map(|v| v * lag)
                    .chain([0.0])
                    .zip([0.0].into_iter().chain(d.iter().copied()))
                    .map(|(a, b)| a + b)
                    .collect()
            });
            let plant = TransferFunction::from_polynomials(&[1.0], &denominator, 0.0, Continuous)
                .unwrap()
                .to_state_space()
                .unwrap();
            let got = bound_samples(
                &plant,
                0,
                std::slice::from_ref(&u),
                delay_s,
                ts,
                0.1,
                &Colour::default(),
            )
            .unwrap();
            assert!((got / exact - 1.0).abs() < 1e-4, "{lags:?}: {got} {exact}");
        }
    }

    #[test]
    fn slow_noise_is_whitened_and_does_not_hide_a_delay_as_white_noise_of_its_power_does() {
        let ts = SampleTime::new(1.0).unwrap();
        let u = Rbs::default().generate(500, &mut ChaCha8Rng::seed_from_u64(3)).unwrap();
        let plant = TransferFunction::from_polynomials(&[1.0], &[1.0, 1.0], 0.0, Continuous)
            .unwrap()
            .to_state_space()
            .unwrap();
        let of = |std: f64, ar: Vec<f64>| {
            bound_samples(
                &plant,
                0,
                std::slice::from_ref(&u),
                9.5,
                ts,
                std,
                &Colour { ar, ..Colour::default() },
            )
            .unwrap()
        };
        let slow = of((1.0_f64 - 0.81).sqrt() * 0.1, vec![-0.9]);
        assert!(slow < 0.7 * of(0.1, vec![]), "{slow}");
    }
}
