//! Systems in series, in parallel and in a loop, with their delays.
//!
//! A model has its delays at its inputs. Where a connection would have an internal delay, sampled models get states for it, which is exact. Continuous ones are
//! refused, because no finite number of states represents it.

use deadtime_signal::decompositions::singular_values;
use nalgebra::DMatrix;

use super::error::ModelError;
use super::state_space::{Continuous, Sampled, StateSpace, TimeDomain};

/// A time domain with interconnections.
pub trait Joins: TimeDomain {
    /// The model without delays: as states, or an error for a delay without states.
    ///
    /// # Errors
    /// [`ModelError::DelayInside`] for a continuous model with a delay.
    fn undelayed(
        sys: &StateSpace<Self>,
        what: &'static str,
    ) -> Result<StateSpace<Self>, ModelError>
    where
        Self: Sized;

    /// The sum of two delays.
    fn sum(one: Self::Delay, other: Self::Delay) -> Self::Delay;
}

impl Joins for Sampled {
    fn undelayed(sys: &StateSpace<Self>, _: &'static str) -> Result<StateSpace<Self>, ModelError> {
        sys.with_delays_as_states()
    }

    fn sum(one: usize, other: usize) -> usize {
        one + other
    }
}

impl Joins for Continuous {
    fn undelayed(
        sys: &StateSpace<Self>,
        what: &'static str,
    ) -> Result<StateSpace<Self>, ModelError> {
        match sys.input_delay().iter().find(|d| **d > 0.0) {
            Some(delay_s) => Err(ModelError::DelayInside { what, delay_s: *delay_s }),
            None => Ok(sys.clone()),
        }
    }

    fn sum(one: f64, other: f64) -> f64 {
        one + other
    }
}

fn fits(what: &'static str, needed: usize, got: usize) -> Result<(), ModelError> {
    if needed == got { Ok(()) } else { Err(ModelError::Count { what, needed, got }) }
}

/// Two models in a common time domain; their block matrices.
fn joined<T: TimeDomain>(
    one: &StateSpace<T>,
    two: &StateSpace<T>,
) -> Result<DMatrix<f64>, ModelError> {
    let (a, b) = (one.domain().sample_time_s(), two.domain().sample_time_s());
    if a != b {
        let rule = "both systems must have one sample time; resample one";
        let value = b.unwrap_or(0.0);
        return Err(ModelError::Number { path: "system".into(), key: "sample_time", value, rule });
    }
    let (n, m) = (one.order(), two.order());
    let mut all = DMatrix::zeros(n + m, n + m);
    all.view_mut((0, 0), (n, n)).copy_from(one.a());
    all.view_mut((n, n), (m, m)).copy_from(two.a());
    Ok(all)
}

fn stacked(above: &DMatrix<f64>, below: &DMatrix<f64>) -> DMatrix<f64> {
    let mut all = DMatrix::zeros(above.nrows() + below.nrows(), above.ncols());
    all.rows_mut(0, above.nrows()).copy_from(above);
    all.rows_mut(above.nrows(), below.nrows()).copy_from(below);
    all
}

fn side_by_side(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    stacked(&left.transpose(), &right.transpose()).transpose()
}

/// The outputs of `first` drive `second`, as MATLAB's `series(first, second)`. Equal delays of the second model's inputs are added to those of the first.
///
/// # Errors
/// [`ModelError::Count`] where outputs and inputs differ in number, [`ModelError::Number`] for different sample times, [`ModelError::DelayInside`] for
/// different continuous delays between the two.
pub fn series<T: Joins>(
    first: &StateSpace<T>,
    second: &StateSpace<T>,
) -> Result<StateSpace<T>, ModelError> {
    fits("inputs of the second system", first.outputs(), second.inputs())?;
    let common = second.input_delay().first().copied();
    let common = common.filter(|d| second.input_delay().iter().all(|other| other == d));
    let (second, delays) = match common {
        Some(delay) => {
            let delays = first.input_delay().iter().map(|d| T::sum(*d, delay)).collect();
            let none = vec![T::Delay::default(); second.inputs()];
            (second.clone().with_input_delay(none)?, delays)
        }
        None => {
            (T::undelayed(second, "between two systems in series")?, first.input_delay().to_vec())
        }
    };
    let mut a = joined(first, &second)?;
    let (n, m) = (first.order(), second.order());
    a.view_mut((n, 0), (m, n)).copy_from(&(second.b() * first.c()));
    let b = stacked(first.b(), &(second.b() * first.d()));
    let c = side_by_side(&(second.d() * first.c()), second.c());
    StateSpace::new(a, b, c, second.d() * first.d(), first.domain())?.with_input_delay(delays)
}

/// The sum of the outputs of two systems with the same inputs, MATLAB's `parallel`.
///
/// # Errors
/// [`ModelError::Count`], [`ModelError::Number`] for different sample times, [`ModelError::DelayInside`] for different continuous delays.
pub fn parallel<T: Joins>(
    one: &StateSpace<T>,
    two: &StateSpace<T>,
) -> Result<StateSpace<T>, ModelError> {
    fits("inputs of the second system", one.inputs(), two.inputs())?;
    fits("outputs of the second system", one.outputs(), two.outputs())?;
    let shared = one.input_delay() == two.input_delay();
    let delays = one.input_delay().to_vec();
    let what = "of one of two systems side by side";
    let (one, two) = if shared {
        let none = vec![T::Delay::default(); one.inputs()];
        (one.clone().with_input_delay(none.clone())?, two.clone().with_input_delay(none)?)
    } else {
        (T::undelayed(one, what)?, T::undelayed(two, what)?)
    };
    let a = joined(&one, &two)?;
    let (b, c) = (stacked(one.b(), two.b()), side_by_side(one.c(), two.c()));
    let sum = StateSpace::new(a, b, c, one.d() + two.d(), one.domain())?;
    if shared { sum.with_input_delay(delays) } else { Ok(sum) }
}

/// The loop y = `forward`·(u + `sign`·`back`·y), MATLAB's `feedback(forward, back, sign)`; `sign` is −1 for negative feedback.
///
/// # Errors
/// [`ModelError::Count`], [`ModelError::Number`] for different sample times, [`ModelError::DelayInside`] for continuous delays in the loop,
/// [`ModelError::AlgebraicLoop`] where the direct paths make the loop singular.
pub fn feedback<T: Joins>(
    forward: &StateSpace<T>,
    back: &StateSpace<T>,
    sign: f64,
) -> Result<StateSpace<T>, ModelError> {
    fits("inputs of the system in the feedback", forward.outputs(), back.inputs())?;
    fits("outputs of the system in the feedback", forward.inputs(), back.outputs())?;
    let what = "in a loop";
    let (forward, back) = (T::undelayed(forward, what)?, T::undelayed(back, what)?);
    let blocks = joined(&forward, &back)?;
    let (n, m) = (forward.order(), back.order());
    // e = u + sign·(C₂x₂ + D₂y), y = C₁x₁ + D₁e.
    let p = forward.outputs();
    let inside = DMatrix::identity(p, p) - forward.d() * back.d() * sign;
    if singular_values(&inside).is_some_and(|s| s.min() <= f64::EPSILON * s.max()) {
        return Err(ModelError::AlgebraicLoop);
    }
    let solved = inside.lu();
    let of = |right: &DMatrix<f64>| solved.solve(right).ok_or(ModelError::AlgebraicLoop);
    let c = of(&side_by_side(forward.c(), &(forward.d() * back.c() * sign)))?;
    let d = of(forward.d())?;
    let mut to_error = back.d() * &c * sign;
    let own = back.c() * sign;
    let mut behind = to_error.columns_mut(n, m);
    behind += &own;
    let error_of_input =
        DMatrix::identity(forward.inputs(), forward.inputs()) + back.d() * &d * sign;
    let a = blocks + stacked(&(forward.b() * to_error), &(back.b() * &c));
    let b = stacked(&(forward.b() * error_of_input), &(back.b() * &d));
    StateSpace::new(a, b, c, d, forward.domain())
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_signal::time::SampleTime;
    use nalgebra::Complex;

    fn drawn(order: usize, inputs: usize, outputs: usize, seed: usize) -> [DMatrix<f64>; 4] {
        let entry = |salt: usize| {
            move |i: usize, j: usize| {
                (0.7 + seed as f64 + 1.9 * (i + salt) as f64 + 3.1 * ((j + 1) * (j + salt)) as f64)
                    .sin()
            }
        };
        [
            DMatrix::from_fn(order, order, entry(1)) * 0.4,
            DMatrix::from_fn(order, inputs, entry(2)),
            DMatrix::from_fn(outputs, order, entry(3)),
            DMatrix::from_fn(outputs, inputs, entry(4)),
        ]
    }

    fn sampled(
        order: usize,
        (inputs, outputs): (usize, usize),
        seed: usize,
        delay: Vec<usize>,
    ) -> StateSpace<Sampled> {
        let [a, b, c, d] = drawn(order, inputs, outputs, seed);
        let ts = SampleTime::new(0.1).unwrap();
        StateSpace::sampled(a, b, c, d, ts).unwrap().with_input_delay(delay).unwrap()
    }

    fn near(got: &DMatrix<Complex<f64>>, expected: &DMatrix<Complex<f64>>) {
        assert!((got - expected).norm() < 1e-11 * (1.0 + expected.norm()), "{got} {expected}");
    }

    /// The response of a connection equals that connection of the responses, including delays of any number of samples.
    #[test]
    fn connections_of_systems_are_connections_of_responses() {
        for seed in 0..6 {
            let one = sampled(3, (2, 2), seed, vec![seed % 3, 2]);
            let two = sampled(2, (2, 2), seed + 10, vec![1, seed % 4]);
            let identity = DMatrix::<Complex<f64>>::identity(2, 2);
            for omega in [0.3, 4.0, 21.0] {
                let (g, h) = (one.frequency_response(omega), two.frequency_response(omega));
                near(&series(&one, &two).unwrap().frequency_response(omega), &(&h * &g));
                near(&parallel(&one, &two).unwrap().frequency_response(omega), &(&g + &h));
                for sign in [-1.0, 1.0] {
                    let inside = &identity - &g * &h * Complex::new(sign, 0.0);
                    let expected = inside.lu().solve(&g).unwrap();
                    near(&feedback(&one, &two, sign).unwrap().frequency_response(omega), &expected);
                }
            }
        }
    }

    #[test]
    fn continuous_delays_move_to_the_inputs_or_are_refused() {
        let of = |seed: usize, delay: Vec<f64>| {
            let [a, b, c, d] = drawn(2, 2, 2, seed);
            StateSpace::continuous(a, b, c, d).unwrap().with_input_delay(delay).unwrap()
        };
        let (one, two) = (of(1, vec![0.3, 0.1]), of(2, vec![0.25, 0.25]));
        let both = series(&one, &two).unwrap();
        assert_eq!(both.input_delay(), [0.55, 0.35]);
        let (g, h) = (one.frequency_response(3.0), two.frequency_response(3.0));
        near(&both.frequency_response(3.0), &(h * g));
        assert!(matches!(series(&two, &one), Err(ModelError::DelayInside { .. })));
        assert!(matches!(parallel(&one, &two), Err(ModelError::DelayInside { .. })));
        assert!(matches!(
            feedback(&one, &of(3, vec![0.0; 2]), -1.0),
            Err(ModelError::DelayInside { .. })
        ));
        assert_eq!(parallel(&one, &one).unwrap().input_delay(), one.input_delay());
    }

    #[test]
    fn a_loop_without_a_solution_and_counts_that_do_not_fit_are_refused() {
        let gain = |v: f64| {
            let none = DMatrix::zeros(0, 0);
            StateSpace::continuous(
                none,
                DMatrix::zeros(0, 1),
                DMatrix::zeros(1, 0),
                DMatrix::from_element(1, 1, v),
            )
            .unwrap()
        };
        assert!(matches!(feedback(&gain(2.0), &gain(0.5), 1.0), Err(ModelError::AlgebraicLoop)));
        let loop_gain = feedback(&gain(2.0), &gain(0.5), -1.0).unwrap();
        assert_eq!(loop_gain.d()[(0, 0)], 1.0);
        let wide = sampled(1, (2, 1), 1, vec![0, 0]);
        assert!(matches!(series(&wide, &wide), Err(ModelError::Count { .. })));
    }
}
