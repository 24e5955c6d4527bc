//! State-space models from records: against numpy, against the truth, and what is said where no model can be had.

use crate::support::compare::{Comparison, apart, golden, list, matrix, text};
use approx::assert_abs_diff_eq;
use deadtime::identify::IdentifyError;
use deadtime::identify::subspace::{
    Direct, Identified, Identifier, Moesp, N4sid, Named, Pbsidopt, Recordings, Settings, Stretch,
    Sure,
};
use deadtime::model::c2d::{Conversion, ZeroOrderHold};
use deadtime::model::uav::Dynamics;
use deadtime::progress::HowFar;
use deadtime::time::SampleTime;
use nalgebra::{Complex, DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

fn named(names: &[&str]) -> Vec<Named> {
    names.iter().map(|n| Named { name: (*n).to_owned(), unit: None }).collect()
}

fn recordings(u: DMatrix<f64>, y: DMatrix<f64>) -> Recordings {
    let (inputs, outputs) =
        (named(&["u1", "u2", "u3"][..u.nrows()]), named(&["y1", "y2"][..y.nrows()]));
    Recordings {
        sample_time: SampleTime::new(0.02).unwrap(),
        inputs,
        outputs,
        stretches: vec![Stretch { u, y }],
    }
}

fn poles(a: &DMatrix<f64>) -> Vec<Complex<f64>> {
    let mut poles: Vec<_> = a.complex_eigenvalues().iter().copied().collect();
    poles.sort_by(|a, b| a.re.total_cmp(&b.re).then(a.im.total_cmp(&b.im)));
    poles
}

#[test]
fn the_methods_agree_with_explicit_matrices_in_numpy() {
    let file = golden("subspace", "reference.json");
    let mut c = Comparison::new("subspace/reference.json");
    let data = recordings(matrix(&file["u"]).transpose(), matrix(&file["y"]).transpose());
    let number = |key: &str| usize::try_from(file[key].as_u64().unwrap()).unwrap();
    let settings = Settings {
        order: Some(number("order")),
        past: Some(number("past")),
        draws: 0,
        ..Settings::default()
    };
    for case in file["cases"].as_array().unwrap() {
        let found = match case["id"].as_str().unwrap() {
            "pbsidopt" => Pbsidopt(settings.clone()).identify(&data, &HowFar::default()),
            "n4sid" => N4sid(settings.clone()).identify(&data, &HowFar::default()),
            _ => Moesp(settings.clone()).identify(&data, &HowFar::default()),
        };
        let found = found.unwrap();
        let model = &found.model;
        let mut close = |what: &str, got: &DMatrix<f64>, wanted: &DMatrix<f64>| {
            c.check(what, text(case, "id"), apart(got, wanted), 1e-8)
        };
        let singular = list(&case["singular"]);
        let ours: Vec<f64> =
            found.order.candidates.iter().take(singular.len()).map(|c| c.singular_value).collect();
        close(
            "singular values",
            &DMatrix::from_vec(1, ours.len(), ours),
            &DMatrix::from_vec(1, singular.len(), singular),
        );
        let ours: Vec<f64> = poles(&model.a).iter().flat_map(|p| [p.re, p.im]).collect();
        close("poles", &DMatrix::from_row_slice(3, 2, &ours), &matrix(&case["poles"]));
        let markov = |b: &DMatrix<f64>| {
            let mut all = DMatrix::zeros(2, 12);
            let mut moved = b.clone();
            for j in 0..6 {
                all.columns_mut(2 * j, 2).copy_from(&(&model.c * &moved));
                moved = &model.a * moved;
            }
            all
        };
        close("markov parameters", &markov(&model.b), &matrix(&case["markov"]));
        close("markov parameters of the noise", &markov(&model.k), &matrix(&case["noise_markov"]));
    }
    c.finish();
}

/// SLICOT's methods weight and solve in other ways; with little noise and no feedback all of them are near the same model.
#[test]
fn n4sid_and_moesp_agree_with_slicot_by_way_of_octave() {
    let file = golden("subspace", "octave.json");
    let mut c = Comparison::new("subspace/octave.json");
    let data = recordings(matrix(&file["u"]).transpose(), matrix(&file["y"]).transpose());
    let number = |key: &str| usize::try_from(file[key].as_u64().unwrap()).unwrap();
    let settings = Settings {
        order: Some(number("order")),
        past: Some(number("past")),
        draws: 0,
        direct: Direct::Free,
        ..Settings::default()
    };
    for case in file["cases"].as_array().unwrap() {
        let found = match case["id"].as_str().unwrap() {
            "n4sid" => N4sid(settings.clone()).identify(&data, &HowFar::default()),
            _ => Moesp(settings.clone()).identify(&data, &HowFar::default()),
        };
        let model = found.unwrap().model;
        let ours: Vec<f64> = poles(&model.a).iter().flat_map(|p| [p.re, p.im]).collect();
        let tolerance = file["tolerance"]["default"].as_f64().unwrap();
        c.check(
            "poles",
            text(case, "id"),
            apart(&DMatrix::from_row_slice(3, 2, &ours), &matrix(&case["poles"])),
            tolerance,
        );
        let mut all = model.d.clone().insert_columns(2, 12, 0.0);
        let mut moved = model.b.clone();
        for j in 0..6 {
            all.columns_mut(2 + 2 * j, 2).copy_from(&(&model.c * &moved));
            moved = &model.a * moved;
        }
        c.check(
            "markov parameters",
            text(case, "id"),
            apart(&all, &matrix(&case["markov"])),
            tolerance,
        );
    }
    c.finish();
}

/// The thesis' lateral dynamics, unstable, held by u = r − K x; noise on states and outputs; `delay` samples of dead time at the input.
fn flight(samples: usize, seed: u64, delay: usize) -> (Recordings, DMatrix<f64>) {
    let ts = SampleTime::new(0.02).unwrap();
    let plant = ZeroOrderHold::default().c2d(&Dynamics::Lateral.model(), ts).unwrap();
    let gain = DMatrix::from_row_slice(1, 3, &[0.00566, 0.01504, 0.05516]);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let (mut u, mut y) = (DMatrix::zeros(1, samples), DMatrix::zeros(2, samples));
    let mut x = DVector::zeros(3);
    let mut r = 0.0;
    for t in 0..samples {
        if t % 4 == 0 {
            r = 0.02 * normal().signum();
        }
        u[(0, t)] = r - (&gain * &x)[0];
        let acting = if t >= delay { u[(0, t - delay)] } else { 0.0 };
        let v = DVector::from_vec(vec![0.02 * normal(), 0.02 * normal()]);
        y.set_column(t, &(plant.c() * &x + plant.d() * acting + v));
        let w = DVector::from_vec(vec![0.002 * normal(), 0.02 * normal(), 0.0005 * normal()]);
        x = plant.a() * &x + plant.b() * acting + w;
    }
    (recordings(u, y), plant.a().clone())
}

fn identified(data: &Recordings, settings: Settings) -> Identified {
    Pbsidopt(settings).identify(data, &HowFar::default()).unwrap()
}

fn vehicle(trials: u64) {
    let (mut covered, mut of, mut orders) = (0_u64, 0_u64, 0_u64);
    for seed in 0..trials {
        let (data, a) = flight(2000, seed, 0);
        let settings =
            Settings { past: Some(40), direct: Direct::Free, draws: 60, ..Settings::default() };
        let found = identified(&data, settings.clone());
        orders += u64::from(found.order.order == 3);
        let found = if found.order.order == 3 {
            found
        } else {
            identified(&data, Settings { order: Some(3), ..settings })
        };
        for z in poles(&a).into_iter().filter(|z| z.im >= 0.0) {
            let ours = found.poles().into_iter().filter(|p| (p.im > 0.0) == (z.im > 0.0));
            let nearest = ours.min_by(|p, q| {
                (p.re - z.re).hypot(p.im - z.im).total_cmp(&(q.re - z.re).hypot(q.im - z.im))
            });
            covered += u64::from(nearest.is_some_and(|p| p.covers(z)));
            of += 1;
        }
    }
    println!("order 3 in {orders} of {trials}; {covered} of {of} poles within 95 %");
    // 95 % of 80: 4 are missed on average; more than 12 in one of a thousand such tests.
    assert!(10 * orders >= 9 * trials - 5, "{orders}");
    assert!(of == 2 * trials && 80 * covered >= 68 * of, "{covered} of {of}");
}

#[test]
fn the_unstable_vehicle_in_its_loop_has_its_order_and_its_poles_within_their_intervals() {
    vehicle(5);
}

#[test]
#[ignore = "nightly: coverage over flights"]
fn the_unstable_vehicle_in_its_loop_has_its_order_and_its_poles_within_their_intervals_in_forty_flights()
 {
    vehicle(40);
}

#[test]
fn drawn_bands_agree_with_the_delta_method_and_hold_the_true_response() {
    let (data, _) = flight(4000, 77, 0);
    let found = identified(
        &data,
        Settings { order: Some(3), past: Some(40), direct: Direct::Free, ..Settings::default() },
    );
    let truth = ZeroOrderHold::default().c2d(&Dynamics::Lateral.model(), data.sample_time).unwrap();
    let (mut inside, mut all) = (0, 0);
    for (i, response) in found.responses(&[0], 30).unwrap().iter().enumerate() {
        for band in response.bands.iter().filter(|b| b.omega_rad_s > 2.0 && b.omega_rad_s < 100.0) {
            let (gain, [low, high], std) =
                (band.gain, band.gain_ci95.unwrap(), band.gain_std.unwrap());
            let ratio = (high - low) / (2.0 * 1.96 * std);
            assert!(
                (0.7..1.4).contains(&ratio),
                "{} at {}: {low} {gain} {high}, {std}",
                response.output,
                band.omega_rad_s
            );
            let true_gain = truth.frequency_response(band.omega_rad_s)[(i, 0)].norm();
            inside += usize::from((gain - true_gain).abs() < 3.0 * std);
            all += 1;
        }
    }
    println!("{inside} of {all} within three standard deviations");
    assert!(all > 20 && inside * 10 >= all * 9, "{inside} of {all}");
}

#[test]
fn records_without_noise_give_the_plant() {
    let a = DMatrix::from_row_slice(2, 2, &[0.8, 0.3, -0.3, 0.7]);
    let (b, c) = (DVector::from_vec(vec![1.0, 0.5]), DMatrix::from_row_slice(1, 2, &[1e3, 0.0]));
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let (mut u, mut y, mut x) = (DMatrix::zeros(1, 400), DMatrix::zeros(1, 400), DVector::zeros(2));
    for t in 0..400 {
        let draw: f64 = StandardNormal.sample(&mut rng);
        u[(0, t)] = 1e-3 * draw;
        y[(0, t)] = (&c * &x)[0];
        x = &a * &x + &b * u[(0, t)];
    }
    let found = identified(
        &recordings(u, y),
        Settings { order: Some(2), past: Some(6), ..Settings::default() },
    );
    for (got, wanted) in poles(&found.model.a).iter().zip(poles(&a)) {
        // The means that are taken off are those of a record that starts at rest: no steady state, at 1e-6.
        assert!((got - wanted).norm() < 1e-5, "{got} {wanted}");
    }
    let first = (&found.model.c * &found.model.b)[0];
    assert!((first / 1e3 - 1.0).abs() < 1e-5, "{first}");
}

#[test]
fn a_known_delay_is_taken_out_first_and_stands_in_the_model_file() {
    let (data, a) = flight(3000, 5, 4);
    let behind = data.behind_delays(&[4]).unwrap();
    let found = identified(
        &behind,
        Settings { past: Some(40), direct: Direct::Free, ..Settings::default() },
    );
    assert_eq!((found.order.order, found.rows), (3, 2956));
    let file = found.file("delayed", &[4], false).unwrap();
    assert_eq!(file.input_delay_s, [0.08]);
    let continuous = found.file("delayed", &[4], true).unwrap().continuous().unwrap();
    assert_abs_diff_eq!(continuous.input_delay()[0], 0.08, epsilon = 1e-12);
    let growing = continuous.poles().into_iter().map(|p| p.re).fold(f64::MIN, f64::max);
    let truth = poles(&a).into_iter().map(|z| z.ln().re / 0.02).fold(f64::MIN, f64::max);
    assert!((growing - truth).abs() < 0.1 * truth, "{growing} {truth}");
    // Left in, the delay costs states of its own.
    let left = identified(
        &data,
        Settings { past: Some(40), direct: Direct::Free, draws: 0, ..Settings::default() },
    );
    assert!(left.order.order > 3, "{}", left.order.order);
}

#[test]
fn a_record_in_pieces_gives_nearly_the_same_model_and_units_change_nothing() {
    let (data, _) = flight(4000, 9, 0);
    let settings = Settings {
        order: Some(3),
        past: Some(15),
        direct: Direct::Free,
        draws: 0,
        ..Settings::default()
    };
    let whole = identified(&data, settings.clone());
    let cut = |from: usize, n: usize| {
        let s = &data.stretches[0];
        Stretch { u: s.u.columns(from, n).into_owned(), y: s.y.columns(from, n).into_owned() }
    };
    let pieces = Recordings { stretches: vec![cut(0, 1500), cut(1500, 2500)], ..data.clone() };
    let pieces = identified(&pieces, settings.clone());
    assert_eq!(pieces.rows, whole.rows - 15);
    let s = &data.stretches[0];
    let scaled =
        Recordings { stretches: vec![Stretch { u: &s.u * 57.3, y: &s.y * -1e-3 }], ..data.clone() };
    let scaled = identified(&scaled, settings);
    for ((w, p), s) in
        poles(&whole.model.a).iter().zip(poles(&pieces.model.a)).zip(poles(&scaled.model.a))
    {
        assert!((w - p).norm() < 5e-3 && (w - s).norm() < 1e-9, "{w} {p} {s}");
    }
}

#[test]
fn the_errors_of_the_right_model_are_white_and_those_of_a_small_one_are_not() {
    // A past that is cut off leaves a trace in the errors: of the second output, whose predictor forgets slowly, 20 samples are far too few, and 100 enough.
    let checks = |order: usize, past: usize, seed: u64| {
        let (data, _) = flight(6000, seed, 0);
        let (learnt, judged) = data.split(0.5);
        let settings = Settings {
            order: Some(order),
            past: Some(past),
            direct: Direct::Free,
            draws: 0,
            ..Settings::default()
        };
        identified(&learnt, settings).check(&judged)
    };
    let right: Vec<_> = (41..51).map(|seed| checks(3, 100, seed)).collect();
    assert!(
        right.iter().flatten().all(|c| c.simulation.is_none()),
        "an unstable model has no free run"
    );
    for output in 0..2 {
        // Of ten tests at 1 % hardly ever two fail by chance.
        let white: Vec<f64> = right.iter().map(|c| c[output].white.unwrap().p).collect();
        let free: Vec<f64> = right.iter().map(|c| c[output].inputs[0].test.p).collect();
        for p in [white, free] {
            assert!(p.iter().filter(|p| **p > 0.01).count() >= 9, "output {output}: {p:?}");
        }
    }
    let (right, small, short) = (&right[0], checks(1, 100, 41), checks(3, 20, 41));
    assert!(
        small
            .iter()
            .zip(right)
            .all(|(small, right)| small.one_step.unwrap().nrmse > right.one_step.unwrap().nrmse),
        "{small:?}"
    );
    assert!(small.iter().any(|c| c.white.unwrap().p < 1e-6), "{small:?}");
    assert!(short[1].white.unwrap().p < 0.01, "{short:?}");
}

#[test]
fn what_makes_a_model_impossible_is_said() {
    let (data, _) = flight(600, 3, 0);
    let s = &data.stretches[0];
    let fails = |data: &Recordings, settings: Settings| {
        Pbsidopt(settings).identify(data, &HowFar::default()).unwrap_err()
    };
    let two = |second: DMatrix<f64>| {
        let u =
            DMatrix::from_fn(2, s.len(), |i, t| if i == 0 { s.u[(0, t)] } else { second[(0, t)] });
        recordings(u, s.y.clone())
    };
    let constant = fails(&two(DMatrix::from_element(1, 600, 0.1)), Settings::default());
    assert!(
        matches!(&constant, IdentifyError::Constant { channel, .. } if channel == "u2"),
        "{constant}"
    );
    let repeated = fails(&two(&s.u * 3.0), Settings::default());
    assert!(
        matches!(&repeated, IdentifyError::Collinear { channel, others } if channel == "u2" && others == "u1"),
        "{repeated}"
    );
    let wave = DMatrix::from_fn(1, 600, |_, t| (0.3 * t as f64).sin());
    let poor = fails(
        &recordings(wave, s.y.clone()),
        Settings { order: Some(4), past: Some(10), ..Settings::default() },
    );
    assert!(
        matches!(&poor, IdentifyError::NotRich { channel, orders: 2..=3, .. } if channel == "u1"),
        "{poor}"
    );
    let long = fails(&data, Settings { past: Some(100), ..Settings::default() });
    assert!(
        matches!(long, IdentifyError::TooFewRows { past: 100, got: 500, longest, .. } if (1..100).contains(&longest)),
        "{long}"
    );
    assert!(long.to_string().contains("or less"), "{long}");
    let large = fails(&data, Settings { order: Some(30), past: Some(10), ..Settings::default() });
    assert!(matches!(large, IdentifyError::Order { order: 30, past: 10, most: 20 }), "{large}");
    let nothing = fails(&data, Settings { order: Some(0), ..Settings::default() });
    assert!(matches!(nothing, IdentifyError::Option { option: "order", .. }), "{nothing}");
}

#[test]
fn the_order_says_how_sure_it_is_and_the_same_seed_draws_the_same() {
    let (data, _) = flight(3000, 31, 0);
    let settings =
        Settings { past: Some(40), direct: Direct::Free, draws: 20, ..Settings::default() };
    let (once, again) = (identified(&data, settings.clone()), identified(&data, settings.clone()));
    assert_eq!(once, again);
    assert_ne!(once.order.sure, Sure::Given);
    assert_abs_diff_eq!(
        once.order.candidates.iter().map(|c| c.weight).sum::<f64>(),
        1.0,
        epsilon = 1e-9
    );
    assert_eq!(identified(&data, Settings { order: Some(2), ..settings }).order.sure, Sure::Given);
}
