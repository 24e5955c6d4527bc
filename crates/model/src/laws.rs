//! Models against exact arithmetic: golden/polynomials and golden/balance.

use nalgebra::{Complex, DMatrix};
use serde_json::Value;

use crate::c2d::{Conversion, Tustin, ZeroOrderHold, ZeroPoleMatching};
use crate::d2c::d2c;
use crate::lyapunov::{dlyap, lyap};
use crate::riccati::continuous::lqr;
use crate::riccati::discrete::dlqr;
use crate::state_space::{Continuous, Sampled, StateSpace};
use crate::transfer_function::TransferFunction;
use deadtime_signal::time::SampleTime;
use proptest::prelude::*;

fn golden(case: &str) -> Vec<Value> {
    let path = format!("{}/../../golden/{case}/reference.json", env!("CARGO_MANIFEST_DIR"));
    let file: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    file["cases"].as_array().unwrap().clone()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn roots(value: &Value) -> Vec<Complex<f64>> {
    let root = |v: &Value| Complex::new(v[0].as_f64().unwrap(), v[1].as_f64().unwrap());
    value.as_array().unwrap().iter().map(root).collect()
}

fn matrix(value: &Value) -> DMatrix<f64> {
    let rows: Vec<Vec<f64>> = value.as_array().unwrap().iter().map(numbers).collect();
    DMatrix::from_fn(rows.len(), rows.first().map_or(0, Vec::len), |i, j| rows[i][j])
}

/// Largest distance of matched roots, relative to each; for roots at the origin relative to the largest.
fn worst(found: &[Complex<f64>], truth: &[Complex<f64>]) -> f64 {
    let size = truth.iter().map(|r| r.norm()).fold(0.0, f64::max);
    let mut left = found.to_vec();
    let mut ordered = truth.to_vec();
    ordered.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
    ordered.iter().fold(0.0, |worst: f64, root| {
        let apart = |i: &usize| (left[*i] - root).norm();
        let at = (0..left.len()).min_by(|i, j| apart(i).total_cmp(&apart(j))).unwrap();
        let unit = if root.norm() > 0.0 { root.norm() } else { size };
        worst.max((left.remove(at) - root).norm() / unit)
    })
}

#[test]
fn realisations_of_polynomials_have_their_frequency_response() {
    let mut failures = Vec::new();
    for case in golden("polynomials") {
        let [num, den, omega, re, im] =
            ["numerator", "denominator", "omega_rad_s", "h_re", "h_im"].map(|k| numbers(&case[k]));
        let made = TransferFunction::from_polynomials(&num, &den, 0.0, Continuous)
            .and_then(|tf| Ok((tf.to_state_space()?, tf)));
        let Ok((sys, tf)) = made else {
            failures.push(format!("{}: {}", case["id"], made.unwrap_err()));
            continue;
        };
        // A realisation with a direct path, or with zeros next to its poles, sums cancelling terms in a stop band. The error is the rounding of the largest
        // term.
        let most = re.iter().zip(&im).map(|(re, im)| re.hypot(*im)).fold(0.0, f64::max);
        for (k, &w) in omega.iter().enumerate() {
            let truth = Complex::new(re[k], im[k]);
            for (what, h, rounding) in [
                ("factors", tf.frequency_response(w), 0.0),
                ("states", sys.frequency_response(w)[(0, 0)], 1e-14 * most),
            ] {
                let off = (h - truth).norm();
                if off.is_nan() || off > 1e-8 * truth.norm() + rounding {
                    failures.push(format!(
                        "{} {what} at {w}: {:e}",
                        case["id"],
                        off / truth.norm()
                    ));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn poles_and_zeros_in_any_units_are_as_exact_as_those_of_lapack_with_balancing() {
    let mut failures = Vec::new();
    for case in golden("balance") {
        let [a, b, c, d] = ["A", "B", "C", "D"].map(|k| matrix(&case[k]));
        let n = a.nrows();
        let sys = StateSpace::continuous(a, b, c, d).unwrap();
        for (what, found) in [("pole", sys.poles()), ("zero", sys.zeros())] {
            let truth = roots(&case[format!("{what}s").as_str()]);
            if found.len() != truth.len() {
                failures.push(format!(
                    "{}: {} {what}s of {}",
                    case["id"],
                    found.len(),
                    truth.len()
                ));
                continue;
            }
            let floor = n as f64 * 4.0 * f64::EPSILON;
            let theirs = case[format!("{what}_error").as_str()].as_f64().unwrap_or(1e-9);
            let off = worst(&found, &truth);
            if off.is_nan() || off > 30.0 * theirs.max(floor) {
                failures.push(format!("{} {what}s: {off:e}, LAPACK {theirs:e}", case["id"]));
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// scipy.signal.zpk2ss(z, p, 1): four zeros and five poles; the gain at 0 is Πz/Πp.
#[test]
fn a_companion_form_keeps_its_zeros_its_gain_and_its_matched_conversion() {
    let roots = |of: fn(f64) -> f64, n: u32| -> Vec<Complex<f64>> {
        (1..=n).map(|k| Complex::from(of(f64::from(k)))).collect()
    };
    let (zeros, poles) = (roots(|k| -100.0 * (k + 0.5), 4), roots(|k| -100.0 * k, 5));
    let tf = TransferFunction::from_zeros_poles_gain(zeros, poles, 1.0, 0.0, Continuous).unwrap();
    let (num, den) = (tf.numerator(), tf.denominator());
    let a =
        DMatrix::from_fn(
            5,
            5,
            |i, j| {
                if i == 0 { -den[j + 1] } else { f64::from(u8::from(i == j + 1)) }
            },
        );
    let b = DMatrix::from_fn(5, 1, |i, _| f64::from(u8::from(i == 0)));
    let sys =
        StateSpace::continuous(a, b, DMatrix::from_row_slice(1, 5, &num), DMatrix::zeros(1, 1));
    let sys = sys.unwrap();
    let gain = 150.0 * 250.0 * 350.0 * 450.0 / (100.0 * 200.0 * 300.0 * 400.0 * 500.0);
    assert_eq!(sys.zeros().len(), 4);
    let of = sys.transfer_function(0, 0).unwrap().frequency_response(0.0).re;
    assert!((of / gain - 1.0).abs() < 1e-11, "{of} {gain}");
    let ts = SampleTime::new(1e-3).unwrap();
    let matched = ZeroPoleMatching::default().c2d(&sys, ts).unwrap().dc_gain()[(0, 0)];
    assert!((matched / gain - 1.0).abs() < 1e-11, "{matched} {gain}");
}

/// The solution of a problem in one set of units solves it in units scaled by 1e±9.
#[test]
fn a_stabilisable_plant_is_so_in_units_far_apart() {
    let a = DMatrix::from_row_slice(3, 3, &[1.2, 0.3, 0.0, 0.0, 0.9, 0.4, 0.1, 0.0, 1.01]);
    let b = DMatrix::from_column_slice(3, 1, &[0.0, 0.0, 1.0]);
    let one = DMatrix::identity(1, 1);
    let plain = dlqr(&a, &b, &DMatrix::identity(3, 3), &one, None).unwrap();
    let t = [1.0, 1e9, 1e-9];
    let scaled = DMatrix::from_fn(3, 3, |i, j| t[i] * a[(i, j)] / t[j]);
    let b = DMatrix::from_fn(3, 1, |i, _| t[i] * b[(i, 0)]);
    let q = DMatrix::from_fn(3, 3, |i, j| if i == j { t[i].powi(-2) } else { 0.0 });
    let found = dlqr(&scaled, &b, &q, &one, None).unwrap();
    let k = DMatrix::from_fn(1, 3, |_, j| found.k[(0, j)] * t[j]);
    assert!(near(&k, &plain.k, 1e-12), "{k} {}", plain.k);
}

#[test]
fn a_slow_model_is_a_fast_one_in_other_units_of_time() {
    // (1 + 2 T s)/(1 + T s)⁴ for T from microseconds to centuries: gain at 0, at 1/T, and stability.
    for time in [1e-6_f64, 1.0, 86400.0, 3e9] {
        let den = [time.powi(4), 4.0 * time.powi(3), 6.0 * time.powi(2), 4.0 * time, 1.0];
        let tf =
            TransferFunction::from_polynomials(&[2.0 * time, 1.0], &den, 0.0, Continuous).unwrap();
        let sys = tf.to_state_space().unwrap();
        assert!(sys.is_stable());
        let expected = Complex::new(1.0, 2.0) / Complex::new(1.0, 1.0).powi(4);
        let h = sys.frequency_response(1.0 / time)[(0, 0)];
        assert!((h - expected).norm() < 1e-12, "{time}: {h} {expected}");
        let sampled = ZeroOrderHold {}.c2d(&sys, SampleTime::new(0.1 * time).unwrap()).unwrap();
        // With four poles at z = 0.9, 1/(1 − z)⁴ magnifies rounding 10 000 times.
        assert!(sampled.is_stable() && (sampled.dc_gain()[(0, 0)] - 1.0).abs() < 1e-10, "{time}");
        let matched =
            ZeroPoleMatching::default().c2d(&sys, SampleTime::new(0.1 * time).unwrap()).unwrap();
        assert!((matched.dc_gain()[(0, 0)] - 1.0).abs() < 1e-10, "{time}");
    }
}

/// Weights 1e±16 apart, half of them with states in units within 1e±9. Truth by decimal arithmetic, errors relative to the diagonal.
#[test]
fn riccati_equations_of_far_apart_weights_and_units_are_solved_to_their_condition() {
    let mut failures = Vec::new();
    for case in golden("dlqr_far") {
        let [a, b, q, r, x, k] = ["A", "B", "Q", "R", "S", "K"].map(|key| matrix(&case[key]));
        let lqr = match dlqr(&a, &b, &q, &r, None) {
            Ok(lqr) => lqr,
            Err(error) => {
                failures.push(format!("{}: {error}", case["id"]));
                continue;
            }
        };
        let size = x.diagonal().map(f64::sqrt);
        let apart = (&lqr.x - &x).component_div(&(&size * size.transpose())).amax();
        let gains = (0..k.nrows()).map(|i| {
            let unit = |m: &DMatrix<f64>| m.row(i).transpose().component_div(&size);
            (unit(&lqr.k) - unit(&k)).amax() / unit(&k).amax()
        });
        let gains = gains.fold(0.0, f64::max);
        let allowed = |key: &str| 300.0 * f64::EPSILON * case[key].as_f64().unwrap().max(10.0);
        let theirs = case["scipy_error"].as_f64();
        let (x_allowed, k_allowed) = (allowed("condition"), allowed("gain_condition"));
        if apart.is_nan() || apart > x_allowed || gains > k_allowed {
            failures.push(format!(
                "{}: {apart:.1e} of {x_allowed:.1e}, gain {gains:.1e} of {k_allowed:.1e}, scipy {theirs:?}",
                case["id"]
            ));
        }
    }
    assert!(failures.is_empty(), "{} fail\n{}", failures.len(), failures.join("\n"));
}

/// Solutions by exact elimination of the n² equations, a third of them with states in units 2±30 apart. Errors are relative to the diagonal.
#[test]
fn lyapunovs_equations_have_their_exact_solutions() {
    for case in golden("lyapunov") {
        let [a, q, x] = ["A", "Q", "X"].map(|key| matrix(&case[key]));
        let sampled = case["sampled"].as_bool().unwrap();
        let found = if sampled { dlyap(&a, &q) } else { lyap(&a, &q) }.unwrap();
        let size = x.diagonal().map(|v| v.abs().sqrt());
        let off = (found - &x).component_div(&(&size * size.transpose())).amax();
        assert!(off < 1e-12, "{}: {off:e}", case["id"]);
    }
}

/// A model with entries up to 1, its states in units of powers of two.
fn units(n: usize) -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec((-40i32..=40).prop_map(|k| f64::from(k).exp2()), n)
}

fn entries(rows: usize, columns: usize) -> impl Strategy<Value = DMatrix<f64>> {
    prop::collection::vec(-1.0..1.0f64, rows * columns)
        .prop_map(move |v| DMatrix::from_vec(rows, columns, v))
}

/// A, B, C, D and units of the states.
fn model() -> impl Strategy<Value = ([DMatrix<f64>; 4], Vec<f64>)> {
    (1..=8usize, 1..=2usize).prop_flat_map(|(n, m)| {
        (entries(n, n), entries(n, m), entries(m, n), entries(m, m), units(n))
            .prop_map(|(a, b, c, d, t)| ([a, b, c, d], t))
    })
}

fn scaled([a, b, c, d]: &[DMatrix<f64>; 4], t: &[f64]) -> [DMatrix<f64>; 4] {
    let a = DMatrix::from_fn(a.nrows(), a.ncols(), |i, j| a[(i, j)] / t[i] * t[j]);
    let b = DMatrix::from_fn(b.nrows(), b.ncols(), |i, j| b[(i, j)] / t[i]);
    let c = DMatrix::from_fn(c.nrows(), c.ncols(), |i, j| c[(i, j)] * t[j]);
    [a, b, c, d.clone()]
}

fn near(got: &DMatrix<f64>, expected: &DMatrix<f64>, tolerance: f64) -> bool {
    (got - expected).amax() <= tolerance * expected.amax().max(1.0)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, ..ProptestConfig::default() })]

    /// Quantities independent of the states equal those of the original model; the others equal those in the new units.
    #[test]
    fn units_of_the_states_change_no_answer((plain, t) in model(), omega in 0.01..10.0f64) {
        let ts = SampleTime::new(0.1).unwrap();
        let of = |m: &[DMatrix<f64>; 4]| {
            let [a, b, c, d] = m.clone();
            StateSpace::continuous(a, b, c, d).unwrap()
        };
        let other = scaled(&plain, &t);
        let (one, two) = (of(&plain), of(&other));
        let h = one.frequency_response(omega);
        prop_assume!(h.iter().all(|v| v.norm() < 1e6));
        prop_assert!((two.frequency_response(omega) - &h).map(|v| v.norm()).max() < 1e-9);
        for conversion in ["zoh", "tustin"] {
            let of = |sys: &StateSpace<Continuous>| match conversion {
                "zoh" => ZeroOrderHold {}.c2d(sys, ts),
                _ => Tustin::default().c2d(sys, ts),
            };
            let (plain, other) = (of(&one).unwrap(), of(&two).unwrap());
            let matrices = |s: &StateSpace<Sampled>| [s.a(), s.b(), s.c(), s.d()].map(Clone::clone);
            let back = scaled(&matrices(&other), &t.iter().map(|t| 1.0 / t).collect::<Vec<_>>());
            for (got, expected) in back.iter().zip(&matrices(&plain)) {
                prop_assert!(near(got, expected, 1e-11), "{conversion}: {got} {expected}");
            }
            if conversion == "zoh" {
                let (plain, other) = (d2c(&plain).unwrap(), d2c(&other).unwrap());
                let matrices = |s: &StateSpace<Continuous>| [s.a(), s.b(), s.c(), s.d()].map(Clone::clone);
                let back = scaled(&matrices(&other), &t.iter().map(|t| 1.0 / t).collect::<Vec<_>>());
                for (got, expected) in back.iter().zip(&matrices(&plain)) {
                    prop_assert!(near(got, expected, 1e-9), "d2c: {got} {expected}");
                }
            }
        }
        let (norm, again) = (one.norm_hinf().gain, two.norm_hinf().gain);
        prop_assert!(norm == again || (norm / again - 1.0).abs() < 1e-8, "{norm} {again}");
    }

    /// If the problem in its original units has a solution, so does the scaled one, with the same gain and the same cost.
    #[test]
    fn units_of_the_states_change_no_regulator((plain, t) in model(), control in -6.0..6.0f64) {
        let [a, b, c, _] = &plain;
        let m = b.ncols();
        let (q, r) = (c.transpose() * c + DMatrix::identity(a.nrows(), a.nrows()) * 0.01,
                      DMatrix::from_diagonal_element(m, m, 10f64.powf(control)));
        let solved = dlqr(a, b, &q, &r, None);
        prop_assume!(solved.as_ref().is_ok_and(|lqr| lqr.x.norm() < 1e4));
        let solved = solved.unwrap();
        let [a, b, ..] = scaled(&plain, &t);
        let q = DMatrix::from_fn(q.nrows(), q.ncols(), |i, j| q[(i, j)] * t[i] * t[j]);
        let again = dlqr(&a, &b, &q, &r, None);
        prop_assert!(again.is_ok(), "{again:?}");
        let again = again.unwrap();
        let k = DMatrix::from_fn(m, t.len(), |i, j| again.k[(i, j)] / t[j]);
        let x = DMatrix::from_fn(t.len(), t.len(), |i, j| again.x[(i, j)] / t[i] / t[j]);
        prop_assert!(near(&x, &solved.x, 1e-8), "{x} {}", solved.x);
        prop_assert!(near(&k, &solved.k, 1e-7), "{k} {}", solved.k);
    }

    /// The Hamiltonian matrix maps [I; X] onto itself (the equation without a division), and the loop is stable.
    #[test]
    fn continuous_regulators_solve_their_equation_in_any_units((plain, t) in model(), control in -4.0..4.0f64) {
        let [a, b, c, _] = scaled(&plain, &t);
        let m = b.ncols();
        let q = c.transpose() * &c;
        let r = DMatrix::from_diagonal_element(m, m, 10f64.powf(control));
        // A drawn plant may have a nearly uncontrollable mode: only existing solutions are checked.
        let Ok(found) = lqr(&a, &b, &q, &r, None) else { return Ok(()) };
        prop_assert!(found.poles.iter().all(|p| p.re < 0.0));
        // XB first: its terms may cancel to 1e-4, which X·(BR⁻¹Bᵀ)·X would square as rounding.
        let moved = &found.x * &b;
        let taken = &moved * moved.transpose() / 10f64.powf(control);
        let terms = [a.transpose() * &found.x, &found.x * &a, -taken, q];
        let back = |m: &DMatrix<f64>| DMatrix::from_fn(t.len(), t.len(), |i, j| m[(i, j)] / t[i] / t[j]);
        let size = terms.iter().map(|m| back(m).amax()).fold(0.0, f64::max);
        let sum = terms.iter().map(back).sum::<DMatrix<f64>>();
        prop_assert!(sum.amax() < 1e-8 * size, "{:e} {size:e}", sum.amax());
    }
}

/// Known entries of a file are marked among its parameters, and written back with the file; a name of no entry is refused.
#[test]
fn known_entries_of_a_linear_model_are_known_parameters() {
    let text = |known: &str| {
        format!(
            "format = \"deadtime/model@1\"\nname = \"roll\"\nkind = \"lti\"\ninputs = [{{ name = \"r\" }}]\nstates = [{{ name = \"p\" }}, {{ name = \"phi\" }}]\n\
             outputs = [{{ name = \"y\" }}]\nknown = {known}\nA = [[-2.0, 0.5], [1.0, 0.0]]\nB = [[3.0], [0.0]]\nC = [[1.0, 0.0]]\nD = [[0.0]]\n"
        )
    };
    let path = std::path::Path::new("roll.toml");
    let read = |known: &str| crate::ModelDocument::from_toml(&text(known), path);
    let document = read("[\"A_phi_p\"]").unwrap();
    let structure = document.structure().unwrap();
    let known: Vec<&str> =
        structure.parameters.iter().filter(|(_, p)| p.known).map(|(n, _)| n.as_str()).collect();
    assert_eq!((known, structure.parameters.len()), (vec!["A_phi_p"], 4));
    assert_eq!(
        crate::ModelDocument::from_toml(&document.to_toml().unwrap(), path).unwrap(),
        document
    );
    let refused = read("[\"A_phi_phi\"]").unwrap_err().to_string();
    assert!(refused.contains("A_phi_phi") && refused.contains("A_state_from"), "{refused}");
}
