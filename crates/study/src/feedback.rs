//! Loops around a sampled plant, one sample at a time.

use nalgebra::{DMatrix, DVector};

use super::error::Result;
use super::plan::Controller;
use deadtime_model::simulate::SimulateError;
use deadtime_model::{Sampled, StateSpace, dlqr};
use deadtime_signal::time::SampleTime;

/// The signals of a loop: by channel, then by sample.
pub(super) struct Closed {
    /// The plant's inputs.
    pub(super) u: Vec<Vec<f64>>,
    /// Its outputs, noise included.
    pub(super) y: Vec<Vec<f64>>,
    /// Its states.
    pub(super) x: Vec<Vec<f64>>,
}

/// y = B(q)/A(q)·u from rest; a₀ is not 0.
pub(super) fn filtered(numerator: &[f64], denominator: &[f64], u: &[f64]) -> Vec<f64> {
    let mut y: Vec<f64> = Vec::with_capacity(u.len());
    for t in 0..u.len() {
        let moving: f64 = numerator.iter().zip(u[..=t].iter().rev()).map(|(b, u)| b * u).sum();
        let past: f64 = denominator.iter().skip(1).zip(y.iter().rev()).map(|(a, y)| a * y).sum();
        y.push((moving - past) / denominator.first().copied().unwrap_or(1.0));
    }
    y
}

/// u = F(q)·(r − y), y the plant's output and `noise`. The plant must not answer within the sample where the controller does.
pub(super) fn through(
    plant: &StateSpace<Sampled>,
    controller: &Controller,
    reference: &[f64],
    noise: &[f64],
) -> Result<Closed> {
    let (b, a) = (&controller.numerator, &controller.denominator);
    let delay = plant.input_delay().first().copied().unwrap_or(0);
    let direct = if delay == 0 { plant.d()[(0, 0)] } else { 0.0 };
    let mut errors: Vec<f64> = Vec::with_capacity(reference.len());
    let mut u: Vec<f64> = Vec::with_capacity(reference.len());
    let (mut y, mut states) = (
        Vec::with_capacity(reference.len()),
        vec![Vec::with_capacity(reference.len()); plant.order()],
    );
    let mut x = DVector::zeros(plant.order());
    for (t, (r, v)) in reference.iter().zip(noise).enumerate() {
        let before = |u: &[f64], lag: usize| {
            t.checked_sub(lag).and_then(|k| u.get(k)).copied().unwrap_or(0.0)
        };
        let free = (plant.c() * &x)[0]
            + v
            + if delay > 0 { plant.d()[(0, 0)] * before(&u, delay) } else { 0.0 };
        // u = known + gain·(r − y), y = free + direct·u.
        let (first, a0) = (b.first().copied().unwrap_or(0.0), a.first().copied().unwrap_or(1.0));
        let known: f64 =
            (b.iter().skip(1).zip(errors.iter().rev()).map(|(b, e)| b * e).sum::<f64>()
                - a.iter().skip(1).zip(u.iter().rev()).map(|(a, u)| a * u).sum::<f64>())
                / a0;
        let gain = first / a0;
        let input = (known + gain * (r - free)) / (1.0 + gain * direct);
        let output = free + direct * input;
        errors.push(r - output);
        u.push(input);
        y.push(output);
        for (to, x) in states.iter_mut().zip(x.iter()) {
            to.push(*x);
        }
        x = plant.a() * &x + plant.b() * before(&u, delay);
    }
    bounded(Closed { u: vec![u], y: vec![y], x: states }, plant.sample_time())
}

/// u = r − K·(x, the commands on their way to the plant), K by `dlqr` with unit weights on the plant with its delay. The loop is stable for any delay.
pub(super) fn of_states(plant: &StateSpace<Sampled>, reference: &[Vec<f64>]) -> Result<Closed> {
    let (n, m) = (plant.order(), plant.inputs());
    let delays = plant.input_delay();
    let order = n + delays.iter().sum::<usize>();
    let (mut a, mut b) = (DMatrix::zeros(order, order), DMatrix::zeros(order, m));
    a.view_mut((0, 0), (n, n)).copy_from(plant.a());
    let mut at = n;
    for (j, &delay) in delays.iter().enumerate() {
        let column = plant.b().column(j);
        if delay == 0 {
            b.view_mut((0, j), (n, 1)).copy_from(&column);
            continue;
        }
        // A line of `delay` cells: the input enters the last, the first acts on the plant.
        a.view_mut((0, at), (n, 1)).copy_from(&column);
        for cell in 0..delay - 1 {
            a[(at + cell, at + cell + 1)] = 1.0;
        }
        b[(at + delay - 1, j)] = 1.0;
        at += delay;
    }
    let k = dlqr(&a, &b, &DMatrix::identity(order, order), &DMatrix::identity(m, m), None)?.k;
    let samples = reference.first().map_or(0, Vec::len);
    let mut z = DVector::zeros(order);
    let column = |rows: usize| vec![Vec::with_capacity(samples); rows];
    let (mut u, mut y, mut x) = (column(m), column(plant.outputs()), column(n));
    for now in (0..samples).map(|t| DVector::from_fn(m, |j, _| reference[j][t])) {
        let input = now - &k * &z;
        let mut at = n;
        let acting = DVector::from_fn(m, |j, _| {
            let value = if delays[j] == 0 { input[j] } else { z[at] };
            at += delays[j];
            value
        });
        let state = z.rows(0, n).into_owned();
        let output = plant.c() * &state + plant.d() * &acting;
        for (to, from) in u
            .iter_mut()
            .zip(input.iter())
            .chain(y.iter_mut().zip(output.iter()))
            .chain(x.iter_mut().zip(state.iter()))
        {
            to.push(*from);
        }
        z = &a * &z + &b * &input;
    }
    bounded(Closed { u, y, x }, plant.sample_time())
}

fn bounded(closed: Closed, sample_time: SampleTime) -> Result<Closed> {
    let explodes = closed
        .u
        .iter()
        .chain(&closed.y)
        .filter_map(|c| c.iter().position(|v| !v.is_finite()))
        .min();
    explodes.map_or(Ok(closed), |sample| {
        Err(SimulateError::Explodes { time_s: sample_time.to_seconds(sample as f64) }.into())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plant(delay: usize) -> StateSpace<Sampled> {
        let m = DMatrix::from_row_slice;
        let (a, b, c) =
            (m(2, 2, &[1.5, -0.7, 1.0, 0.0]), m(2, 1, &[1.0, 0.0]), m(1, 2, &[0.3, 0.2]));
        let sys = StateSpace::sampled(a, b, c, DMatrix::zeros(1, 1), SampleTime::new(1.0).unwrap())
            .unwrap();
        sys.with_input_delay(vec![delay]).unwrap()
    }

    #[test]
    fn a_loop_is_that_of_its_difference_equations() {
        // y(t) = 1.5y(t−1) − 0.7y(t−2) + 0.3u(t−1−d) + 0.2u(t−2−d) + noise's share, u(t) = u(t−1) + 0.1e(t) − 0.08e(t−1), written out as sums.
        let controller = Controller { numerator: vec![0.2, -0.16], denominator: vec![2.0, -2.0] };
        for delay in [0, 3] {
            let reference: Vec<f64> =
                (0..60).map(|t| if t % 20 < 10 { 1.0 } else { -0.5 }).collect();
            let noise: Vec<f64> = (0..60).map(|t| 0.05 * f64::from((t * 7919 % 13) - 6)).collect();
            let got = through(&plant(delay), &controller, &reference, &noise).unwrap();
            let (mut u, mut clean, mut e) =
                (Vec::<f64>::new(), Vec::<f64>::new(), Vec::<f64>::new());
            for t in 0..60_usize {
                let at = |x: &[f64], lag: usize| if t >= lag { x[t - lag] } else { 0.0 };
                let y = 1.5 * at(&clean, 1) - 0.7 * at(&clean, 2)
                    + 0.3 * at(&u, 1 + delay)
                    + 0.2 * at(&u, 2 + delay);
                e.push(reference[t] - y - noise[t]);
                u.push(at(&u, 1) + 0.1 * e[t] - 0.08 * at(&e, 1));
                clean.push(y);
                assert!(
                    (got.y[0][t] - y - noise[t]).abs() < 1e-12
                        && (got.u[0][t] - u[t]).abs() < 1e-12,
                    "{delay} {t}"
                );
            }
        }
    }

    #[test]
    fn a_plant_that_answers_within_the_sample_closes_an_algebraic_loop() {
        let gain = StateSpace::sampled(
            DMatrix::zeros(0, 0),
            DMatrix::zeros(0, 1),
            DMatrix::zeros(1, 0),
            DMatrix::from_element(1, 1, 2.0),
            SampleTime::new(1.0).unwrap(),
        );
        let controller = Controller { numerator: vec![0.5], denominator: vec![1.0] };
        // u = 0.5·(r − 2u): u = r/4.
        let got = through(&gain.unwrap(), &controller, &[1.0, 2.0], &[0.0, 0.0]).unwrap();
        assert_eq!(got.u[0], [0.25, 0.5]);
    }

    #[test]
    fn state_feedback_holds_a_plant_that_diverges_whatever_the_delay() {
        let m = DMatrix::from_row_slice;
        let unstable = StateSpace::sampled(
            m(1, 1, &[1.2]),
            m(1, 1, &[1.0]),
            m(1, 1, &[1.0]),
            DMatrix::zeros(1, 1),
            SampleTime::new(0.1).unwrap(),
        )
        .unwrap();
        for delay in [0, 1, 7] {
            let sys = unstable.clone().with_input_delay(vec![delay]).unwrap();
            let got = of_states(&sys, &[vec![1.0; 300]]).unwrap();
            assert!(got.y[0].iter().all(|y| y.abs() < 200.0), "{delay}");
            // x(t+1) = 1.2x(t) + u(t − d).
            for t in delay..299 {
                assert!((got.x[0][t + 1] - 1.2 * got.x[0][t] - got.u[0][t - delay]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_filter_is_its_difference_equation() {
        assert_eq!(
            filtered(&[2.0, 1.0], &[2.0, -1.0], &[1.0, 0.0, 0.0, 4.0]),
            [1.0, 1.0, 0.5, 4.25]
        );
    }
}
