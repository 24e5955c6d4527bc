use super::*;
use crate::simulate::error::SimulateError;

/// A right-hand side from a closure.
struct System<F>(usize, F, usize);

impl<F: FnMut(f64, &[f64], &mut [f64])> Rhs for System<F> {
    fn dim(&self) -> usize {
        self.0
    }

    fn eval(&mut self, t: f64, x: &[f64], dx: &mut [f64]) {
        self.2 += 1;
        (self.1)(t, x, dx);
    }
}

fn oscillator() -> System<impl FnMut(f64, &[f64], &mut [f64])> {
    System(
        2,
        |t: f64, x: &[f64], dx: &mut [f64]| {
            dx[0] = x[1];
            dx[1] = -x[0] + 0.1 * t.cos() * x[0] * x[0];
        },
        0,
    )
}

/// log2 of the ratio of errors when the step is halved, with fixed steps through `step(h, count)`.
fn order(step: impl Fn(usize) -> Vec<f64>) -> f64 {
    let exact = step(4096);
    let error = |x: Vec<f64>| x.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    (error(step(32)) / error(step(64))).log2()
}

#[test]
fn the_explicit_method_has_order_five() {
    let found = order(|count| {
        let (mut f, mut x, mut to) = (oscillator(), vec![1.0, 0.3], vec![0.0; 2]);
        let mut rk = dormand_prince::DormandPrince::new(2);
        let h = 4.0 / count as f64;
        for k in 0..count {
            f.eval(k as f64 * h, &x, rk.first());
            rk.step(&mut f, k as f64 * h, h, &x, &mut to);
            x.copy_from_slice(&to);
        }
        x
    });
    assert!((found - 5.0).abs() < 0.3, "{found}");
}

#[test]
fn the_dense_output_has_order_four_inside_a_step() {
    let error = |h: f64| {
        let mut f = oscillator();
        let (x, mut to, mut at, mut exact) = ([1.0, 0.3], [0.0; 2], [0.0; 2], [1.0, 0.3]);
        let mut rk = dormand_prince::DormandPrince::new(2);
        f.eval(0.0, &x, rk.first());
        rk.step(&mut f, 0.0, h, &x, &mut to);
        rk.finish(&mut f, 0.0, h, &x, &to, (1.0, 1.0));
        rk.dense(0.37, h, &x, &to, &mut at);
        let mut fine = Integrator::with_tolerance(2, 1e-13, 1e-13);
        fine.advance(&mut f, 0.0, 0.37 * h, &mut exact).unwrap();
        (at[0] - exact[0]).abs().max((at[1] - exact[1]).abs())
    };
    // One step: the local error, one order above.
    let found = (error(0.4) / error(0.2)).log2();
    assert!(found > 4.6, "{found}");
}

#[test]
fn the_rosenbrock_method_has_order_four_with_time_in_the_equations() {
    let found = order(|count| {
        let (mut f, mut x, mut to, mut error, mut dx) =
            (oscillator(), vec![1.0, 0.3], vec![0.0; 2], vec![0.0; 2], vec![0.0; 2]);
        let mut rodas = rodas::Rodas::new(2);
        let h = 4.0 / count as f64;
        for k in 0..count {
            let t = k as f64 * h;
            f.eval(t, &x, &mut dx);
            rodas.prepare(&mut f, t, &x, &dx, h);
            assert!(rodas.step(&mut f, t, h, &x, &dx, &mut to, &mut error));
            x.copy_from_slice(&to);
        }
        x
    });
    assert!((found - 4.0).abs() < 0.3, "{found}");
}

#[test]
fn the_error_follows_the_tolerance_and_both_methods_agree() {
    let run = |rtol: f64, method: Method| {
        let (mut f, mut x) = (oscillator(), [1.0, 0.3]);
        let mut integrator = Integrator::with_tolerance(2, rtol, rtol);
        integrator.method = method;
        integrator.advance(&mut f, 0.0, 20.0, &mut x).unwrap();
        x
    };
    let exact = run(1e-13, Method::Explicit);
    for rtol in [1e-4, 1e-6, 1e-8, 1e-10] {
        let x = run(rtol, Method::Explicit);
        let error = (x[0] - exact[0]).abs().max((x[1] - exact[1]).abs());
        assert!(error < 50.0 * rtol, "{rtol}: {error}");
    }
    let x = run(1e-9, Method::Rosenbrock);
    assert!((x[0] - exact[0]).abs() < 1e-7, "{x:?} {exact:?}");
}

#[test]
fn a_sample_costs_one_step_of_seven_evaluations() {
    let mut f = oscillator();
    let (mut integrator, mut x) = (Integrator::with_tolerance(2, 1e-6, 1e-9), [1.0, 0.3]);
    for k in 0..1000 {
        integrator.advance(&mut f, f64::from(k) * 0.01, f64::from(k + 1) * 0.01, &mut x).unwrap();
    }
    assert_eq!(integrator.steps(), (1000, 0));
    // One further evaluation for the very first step size.
    assert_eq!(f.2, 7001);
}

/// The state between steps is that of their curve, for any samples. A new right-hand side or a changed state starts a new step.
#[test]
fn steps_past_samples_are_fewer_and_their_curve_is_as_accurate() {
    let exact = {
        let (mut f, mut integrator, mut x) =
            (oscillator(), Integrator::with_tolerance(2, 1e-13, 1e-15), [1.0, 0.3]);
        let mut at = |k: u32| {
            integrator
                .advance(&mut f, f64::from(k) * 0.01, f64::from(k + 1) * 0.01, &mut x)
                .unwrap();
            x
        };
        (0..1000).map(&mut at).collect::<Vec<_>>()
    };
    for method in [Method::Explicit, Method::Rosenbrock] {
        let (mut f, mut integrator, mut x) =
            (oscillator(), Integrator::with_tolerance(2, 1e-7, 1e-9), [1.0, 0.3]);
        integrator.method = method;
        let mut worst: f64 = 0.0;
        for k in 0..1000_u32 {
            if k % 250 != 0 {
                integrator.same_right_hand_side();
            }
            let until = f64::from(k / 250 + 1) * 2.5;
            integrator
                .advance_past(&mut f, (f64::from(k) * 0.01, f64::from(k + 1) * 0.01), until, &mut x)
                .unwrap();
            let there = exact[k as usize];
            if (k, method) == (9, Method::Rosenbrock) {
                // The implicit method's curve is not used: one step per sample, until the explicit method is found equally good.
                assert!(integrator.steps().0 >= 10, "{:?}", integrator.steps());
            }
            worst = worst.max((x[0] - there[0]).abs()).max((x[1] - there[1]).abs());
        }
        assert!(worst < 1e-5, "{method:?}: {worst:e}");
        // At most 1/8 of the steps from sample to sample.
        let (made, _) = integrator.steps();
        assert!(made < 125, "{method:?}: {made}");
    }
}

#[test]
fn a_bouncing_ball_hits_the_floor_when_it_should() {
    let mut f = System(2, |_: f64, x: &[f64], dx: &mut [f64]| (dx[0], dx[1]) = (x[1], -9.81), 0);
    for scale in [1.0, 1e-3] {
        let (mut integrator, mut x, mut t) =
            (Integrator::with_tolerance(2, 1e-8, 1e-12), [scale, 0.0], 0.0);
        let first = (2.0 * scale / 9.81_f64).sqrt();
        let mut expect = first;
        for bounce in 1..=6 {
            let hit = integrator
                .advance_until(&mut f, t, t + 10.0, &mut x, &mut |_, x| x[0])
                .unwrap()
                .unwrap();
            assert!((hit - expect).abs() < 1e-11 * expect, "bounce {bounce}: {hit} {expect}");
            assert!(x[0] <= 0.0 && x[0] > -1e-11 * scale, "{x:?}");
            x = [0.0, -0.8 * x[1]];
            t = hit;
            expect += 2.0 * first * 0.8_f64.powi(bounce);
        }
    }
}

#[test]
fn an_event_needs_a_change_of_sign_after_the_start() {
    let mut f = System(2, |_: f64, x: &[f64], dx: &mut [f64]| (dx[0], dx[1]) = (x[1], -x[0]), 0);
    let mut integrator = Integrator::new(2);
    // sin t: 0 at the start, then again at π; the returned state lies behind the change.
    let mut x = [0.0, 1.0];
    assert_eq!(integrator.advance_until(&mut f, 0.0, 3.0, &mut x, &mut |_, x| x[0]).unwrap(), None);
    let mut x = [0.0, 1.0];
    let at =
        integrator.advance_until(&mut f, 0.0, 10.0, &mut x, &mut |_, x| x[0]).unwrap().unwrap();
    assert!((at - std::f64::consts::PI).abs() < 1e-6 && x[0] <= 0.0 && x[0] > -1e-11, "{at} {x:?}");
    // Continuing from there, the next change is that at 2π, not the one just found.
    let next =
        integrator.advance_until(&mut f, at, 10.0, &mut x, &mut |_, x| x[0]).unwrap().unwrap();
    assert!((next - 2.0 * std::f64::consts::PI).abs() < 1e-6, "{next}");
    // An event in time alone, at the end of the interval.
    let mut x = [0.0, 1.0];
    assert_eq!(
        integrator.advance_until(&mut f, 0.0, 0.25, &mut x, &mut |t, _| t - 0.25).unwrap(),
        Some(0.25)
    );
    // Two changes within one step.
    let mut x = [0.0, 0.0];
    let mut still = System(2, |_: f64, _: &[f64], dx: &mut [f64]| dx.fill(0.0), 0);
    let mut event = |t: f64, _: &[f64]| (t - 0.3) * (t - 0.6);
    let at = Integrator::new(2)
        .advance_until(&mut still, 0.0, 1.0, &mut x, &mut event)
        .unwrap()
        .unwrap();
    assert!((at - 0.3).abs() < 1e-11, "{at}");
}

#[test]
fn dry_friction_stops_a_sliding_mass() {
    let mut f = System(
        2,
        |_: f64, x: &[f64], dx: &mut [f64]| (dx[0], dx[1]) = (x[1], -2.0 - 0.5 * x[1]),
        0,
    );
    let (mut integrator, mut x) = (Integrator::with_tolerance(2, 1e-10, 1e-10), [0.0, 3.0]);
    let at = integrator.advance_until(&mut f, 0.0, 5.0, &mut x, &mut |_, x| x[1]).unwrap().unwrap();
    // v = (3 + 4) e^{−t/2} − 4.
    assert!((at - 2.0 * (7.0_f64 / 4.0).ln()).abs() < 1e-10, "{at}");
    assert!(x[1].abs() < 1e-11);
}

fn robertson() -> System<impl FnMut(f64, &[f64], &mut [f64])> {
    System(
        3,
        |_: f64, x: &[f64], dx: &mut [f64]| {
            dx[0] = -0.04 * x[0] + 1e4 * x[1] * x[2];
            dx[2] = 3e7 * x[1] * x[1];
            dx[1] = -dx[0] - dx[2];
        },
        0,
    )
}

fn van_der_pol(mu: f64) -> System<impl FnMut(f64, &[f64], &mut [f64])> {
    System(
        2,
        move |_: f64, x: &[f64], dx: &mut [f64]| {
            (dx[0], dx[1]) = (x[1], mu * ((1.0 - x[0] * x[0]) * x[1]) - x[0])
        },
        0,
    )
}

/// Expected values: scipy 1.17.1 solve_ivp, Radau, rtol 1e-12, atol 1e-16.
#[test]
fn stiff_problems_agree_with_radau() {
    let mut f = robertson();
    let (mut integrator, mut x, mut t) =
        (Integrator::with_tolerance(3, 1e-6, 1e-10), [1.0, 0.0, 0.0], 0.0);
    for (end, expect) in ROBERTSON {
        integrator.advance(&mut f, t, end, &mut x).unwrap();
        for i in 0..3 {
            assert!((x[i] - expect[i]).abs() < 2e-5 * expect[i] + 1e-9, "t = {end}: {x:?}");
        }
        t = end;
    }
    assert_eq!(integrator.method(), Method::Rosenbrock);
    println!("robertson: steps {:?}, {} evaluations", integrator.steps(), f.2);
    for (mu, end, expect) in VAN_DER_POL {
        let mut f = van_der_pol(mu);
        let (mut integrator, mut x) = (Integrator::with_tolerance(2, 1e-6, 1e-9), [2.0, 0.0]);
        integrator.advance(&mut f, 0.0, end, &mut x).unwrap();
        println!("van der pol {mu:e}: steps {:?}, {} evaluations, {x:?}", integrator.steps(), f.2);
        assert!((x[0] - expect[0]).abs() < 1e-4 * expect[0].abs(), "mu {mu}: {x:?}");
        assert!((x[1] - expect[1]).abs() < 1e-3 * expect[1].abs(), "mu {mu}: {x:?}");
        assert!(f.2 < 30_000, "{}", f.2);
    }
}

#[test]
fn a_fast_mode_far_below_the_sample_time_is_no_obstacle() {
    let mut f = System(
        2,
        |t: f64, x: &[f64], dx: &mut [f64]| (dx[0], dx[1]) = (-1e6 * (x[0] - t.sin()), x[0] - x[1]),
        0,
    );
    let (mut integrator, mut x) = (Integrator::with_tolerance(2, 1e-8, 1e-10), [0.0, 1.0]);
    for k in 0..100 {
        integrator.advance(&mut f, f64::from(k) * 0.1, f64::from(k + 1) * 0.1, &mut x).unwrap();
    }
    assert!((x[0] - 10f64.sin()).abs() < 1e-5 && f.2 < 20_000, "{x:?} {}", f.2);
}

#[test]
fn what_cannot_be_integrated_says_when_and_why() {
    let mut square = System(1, |_: f64, x: &[f64], dx: &mut [f64]| dx[0] = x[0] * x[0], 0);
    let fails = |e: Result<(), SimulateError>| e.unwrap_err();
    match fails(Integrator::new(1).advance(&mut square, 0.0, 2.0, &mut [1.0])) {
        SimulateError::Explodes { time_s } => assert!((time_s - 1.0).abs() < 1e-6, "{time_s}"),
        e => panic!("{e}"),
    }
    let mut growth = System(1, |_: f64, x: &[f64], dx: &mut [f64]| dx[0] = x[0], 0);
    assert!(matches!(
        fails(Integrator::new(1).advance(&mut growth, 0.0, 1e4, &mut [1.0])),
        SimulateError::Explodes { .. }
    ));
    // The state reaches the edge of a square root's domain after 2 s.
    let mut root =
        System(1, |_: f64, x: &[f64], dx: &mut [f64]| dx[0] = -1.0 - x[0].sqrt() * 0.0, 0);
    let (mut integrator, mut x) = (Integrator::new(1), [2.0]);
    match fails(integrator.advance(&mut root, 0.0, 3.0, &mut x)) {
        SimulateError::Undefined { time_s } => assert!((time_s - 2.0).abs() < 1e-6, "{time_s}"),
        e => panic!("{e}"),
    }
    assert!(integrator.breakdown().unwrap().1[0] < 0.0);
    let mut nan = System(1, |_: f64, _: &[f64], dx: &mut [f64]| dx[0] = f64::NAN, 0);
    assert!(matches!(
        fails(Integrator::new(1).advance(&mut nan, 0.0, 1.0, &mut [0.0])),
        SimulateError::Undefined { time_s: 0.0 }
    ));
    assert!(matches!(
        fails(Integrator::new(1).advance(&mut square, 1.0, 0.0, &mut [0.0])),
        SimulateError::Backwards { .. }
    ));
    assert!(matches!(
        fails(Integrator::new(2).advance(&mut square, 0.0, 1.0, &mut [0.0])),
        SimulateError::InitialState { .. }
    ));
    let mut few = Integrator::new(2);
    few.max_steps = 5;
    assert!(matches!(
        fails(few.advance(&mut oscillator(), 0.0, 1e3, &mut [1.0, 0.0])),
        SimulateError::Stiff { .. }
    ));
}

const ROBERTSON: [(f64, [f64; 3]); 4] = [
    (0.4, [0.9851721138609891, 3.386395378974876e-05, 0.014794022185221495]),
    (40.0, [0.7158270687194156, 9.1855347645587e-06, 0.28416374574582115]),
    (4000.0, [0.18320225777694973, 8.942371252777484e-07, 0.816796847985926]),
    (400000.0, [0.004938274520998163, 1.9849940879617855e-08, 0.9950617056290616]),
];

const VAN_DER_POL: [(f64, f64, [f64; 2]); 3] = [
    (10000.0, 12000.0, [-1.6994152592624006, 9.00108181700036e-05]),
    (100000.0, 120000.0, [-1.6994013156775987, 9.00123395850083e-06]),
    (1000000.0, 1200000.0, [-1.6994006674772073, 9.001241029419192e-07]),
];
