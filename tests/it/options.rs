//! What the options of the estimators change: thresholds, averaging over records, and the ways to read a delay from coefficients.

use approx::assert_abs_diff_eq;
use deadtime::delay::{
    DelayEstimate, DelayEstimator, Experiment, Oestruc, Outcome, PlantModel, Prewindow, Recording,
    Records, Search, Selection, Series, StateLeastSquares, Threshold,
};
use deadtime::model::StateSpace;
use deadtime::signal::{NoiseColour, add_noise, unit_noise};
use deadtime::simulate::{Options, lsim};
use deadtime::time::SampleTime;
use nalgebra::DMatrix;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

fn ts() -> SampleTime {
    SampleTime::new(1.0).unwrap()
}

fn white(samples: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    unit_noise(samples, &NoiseColour::White, rng).unwrap()
}

fn one(estimator: &dyn DelayEstimator, experiment: &Experiment, search: &Search) -> DelayEstimate {
    estimator.estimate(experiment, search).unwrap()
}

/// Share of records of pure noise in which the threshold is crossed.
fn false_alarms(threshold: Threshold) -> f64 {
    let search = Search { max_delay: 70, default_bias: 0, ..Search::default() };
    let records = 300;
    let crossed = (0..records)
        .filter(|&seed| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let (u, y) = (white(500, &mut rng), white(500, &mut rng));
            one(&threshold, &Experiment::siso(ts(), u, y).unwrap(), &search).outcome
                != Outcome::NotVisible
        })
        .count();
    crossed as f64 / records as f64
}

#[test]
fn three_standard_deviations_alarm_in_a_sixth_of_white_records_and_a_family_wise_limit_in_one_of_twenty()
 {
    // 1 − 0.9973^71 = 0.175; binomial standard deviation 0.022.
    let three = false_alarms(Threshold { h_std: 3.0, ..Threshold::default() });
    assert!((0.10..0.27).contains(&three), "{three}");
    // 0.05, standard deviation 0.013.
    let family = false_alarms(Threshold { family_wise: Some(0.05), ..Threshold::default() });
    assert!((0.005..0.10).contains(&family), "{family}");
    assert!(false_alarms(Threshold::default()) < 0.01);
}

#[test]
fn averaging_over_records_finds_what_one_record_hides() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let record = |rng: &mut ChaCha8Rng| {
        let u = white(400, rng);
        let mut y = vec![0.0; 400];
        for t in 6..400 {
            y[t] = 0.5 * y[t - 1] + u[t - 6];
        }
        Recording {
            inputs: vec![u.into()],
            outputs: vec![Series::from(add_noise(&y, 0.1, &NoiseColour::White, rng).unwrap())],
            states: Vec::new(),
        }
    };
    let recordings: Vec<_> = (0..30).map(|_| record(&mut rng)).collect();
    let of = |recordings: &[Recording<'static>]| {
        Experiment::new(ts(), vec!["u".into()], vec!["y".into()], recordings.to_vec()).unwrap()
    };
    let search = Search::default();
    for records in [Records::Joint, Records::Averaged] {
        // The mean of thirty standard deviations stays one record's, so the averaged threshold is a higher bar for the same response.
        let threshold = Threshold {
            records,
            h_std: if records == Records::Averaged { 1.5 } else { 5.0 },
            ..Threshold::default()
        };
        let answer = one(&threshold, &of(&recordings), &search);
        assert_eq!((answer.outcome, answer.delay_s), (Outcome::Found, Some(5.0)), "{records:?}");
        let first = of(&recordings[..1]);
        let alone = one(&Threshold { records, ..Threshold::default() }, &first, &search);
        assert_eq!(alone.outcome, Outcome::NotVisible, "{records:?}");
    }
}

/// Two inputs, delayed by 2 and 9 samples, and three states with noise on each.
fn two_inputs(noise: f64) -> Experiment<'static> {
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    let a = DMatrix::from_row_slice(3, 3, &[0.8, 0.1, 0.0, -0.2, 0.7, 0.1, 0.0, 0.1, 0.6]);
    let b = DMatrix::from_row_slice(3, 2, &[1.0, 0.2, 0.0, 1.0, 0.5, -0.3]);
    let plant =
        StateSpace::sampled(a, b, DMatrix::identity(3, 3), DMatrix::zeros(3, 2), ts()).unwrap();
    let inputs: Vec<Vec<f64>> = (0..2).map(|_| white(400, &mut rng)).collect();
    let u = DMatrix::from_fn(400, 2, |k, j| inputs[j][k]);
    let x =
        lsim(&plant.clone().with_input_delay(vec![2, 9]).unwrap(), &u, ts(), &Options::default())
            .unwrap()
            .x;
    let states: Vec<Vec<f64>> = (0..3)
        .map(|i| x.column(i).iter().zip(white(400, &mut rng)).map(|(x, e)| x + noise * e).collect())
        .collect();
    let recording = Recording {
        inputs: inputs.into_iter().map(Into::into).collect(),
        outputs: vec![Series::from(states[0].clone())],
        states: states.into_iter().map(Into::into).collect(),
    };
    let experiment = Experiment::new(
        ts(),
        vec!["first".into(), "second".into()],
        vec!["y".into()],
        vec![recording],
    )
    .unwrap();
    experiment.with_model(PlantModel::Sampled(plant))
}

fn delays(selection: Selection, noise: f64) -> Vec<f64> {
    let answers = StateLeastSquares { selection, ..StateLeastSquares::default() }
        .estimate_inputs(&two_inputs(noise), &Search { max_delay: 15, ..Search::default() })
        .unwrap();
    answers.iter().map(|a| a.delay_s.unwrap()).collect()
}

#[test]
fn both_inputs_have_their_own_delay_and_the_largest_coefficient_stands_noise() {
    for noise in [0.0, 0.3] {
        let found = delays(Selection::Largest, noise);
        // Noise of 0.3 on states of size one: a tenth of a sample.
        assert!(
            (found[0] - 2.0).abs() < 1e-9 + 0.3 * noise
                && (found[1] - 9.0).abs() < 1e-9 + 0.3 * noise,
            "{noise}: {found:?}"
        );
    }
    // Without noise the product sum is the same; with it, it gathers the noise of sixteen coefficients.
    let sum = delays(Selection::ProductSum, 0.0);
    assert!((sum[0] - 2.0).abs() < 1e-9 && (sum[1] - 9.0).abs() < 1e-9, "{sum:?}");
    let error = |found: &[f64]| (found[0] - 2.0).abs() + (found[1] - 9.0).abs();
    assert!(error(&delays(Selection::ProductSum, 0.3)) > error(&delays(Selection::Largest, 0.3)));
}

#[test]
fn the_largest_product_is_never_negative_and_misses_where_noise_stands_at_a_long_lag() {
    assert!(delays(Selection::LargestProduct, 0.3).iter().all(|&d| d >= 0.0));
    // max γt overstates: the noise at lag 15 alone can reach what γ = 1 does at lag 2.
    let found = delays(Selection::LargestProduct, 1.0);
    assert!(found[0] > 2.0, "{found:?}");
}

/// One state of a plant at rest, moved by a pulse of three samples.
fn pulsed(at: usize) -> Experiment<'static> {
    let plant = StateSpace::sampled(
        DMatrix::from_element(1, 1, 0.9),
        DMatrix::identity(1, 1),
        DMatrix::identity(1, 1),
        DMatrix::zeros(1, 1),
        ts(),
    )
    .unwrap();
    let u: Vec<f64> = (0..80).map(|k| if (at..at + 3).contains(&k) { 1.0 } else { 0.0 }).collect();
    let rest = Options { prehistory: deadtime::simulate::Prehistory::Rest, ..Options::default() };
    let x = lsim(
        &plant.clone().with_input_delay(vec![4]).unwrap(),
        &DMatrix::from_column_slice(80, 1, &u),
        ts(),
        &rest,
    )
    .unwrap()
    .x;
    let x: Vec<f64> = x.column(0).iter().copied().collect();
    let recording = Recording {
        inputs: vec![u.into()],
        outputs: vec![x.clone().into()],
        states: vec![x.into()],
    };
    let experiment =
        Experiment::new(ts(), vec!["u".into()], vec!["y".into()], vec![recording]).unwrap();
    experiment.with_model(PlantModel::Sampled(plant))
}

#[test]
fn what_is_known_before_a_record_lets_states_tell_of_an_early_pulse() {
    let answer = |at, prewindow| {
        one(
            &StateLeastSquares { prewindow, ..StateLeastSquares::default() },
            &pulsed(at),
            &Search::default(),
        )
    };
    // A pulse in the first samples has gone by before every lag can be looked back to.
    for at in [0, 10] {
        assert_eq!(answer(at, Prewindow::None).outcome, Outcome::Singular);
        assert_abs_diff_eq!(answer(at, Prewindow::Rest).delay_s.unwrap(), 4.0, epsilon = 1e-6);
    }
    // Ten still samples are a rest that is seen; a pulse at the very start leaves none.
    assert_abs_diff_eq!(answer(10, Prewindow::Auto).delay_s.unwrap(), 4.0, epsilon = 1e-6);
    assert_eq!(answer(0, Prewindow::Auto).outcome, Outcome::Singular);
}

#[test]
fn as_published_oestruc_answers_where_it_has_nothing_to_go_by() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let unrelated = Experiment::siso(ts(), white(200, &mut rng), white(200, &mut rng)).unwrap();
    let asked = one(&Oestruc::default(), &unrelated, &Search::default());
    assert_eq!((asked.outcome, asked.delay_s), (Outcome::NotVisible, None));
    let made = one(
        &Oestruc { always_answers: true, ..Oestruc::default() },
        &unrelated,
        &Search::default(),
    );
    assert_eq!(made.outcome, Outcome::Found);
    // It says nothing more than that the delay lies in the window, and says why.
    assert_eq!(made.ci95_s.unwrap()[1], 34.0);
    assert_eq!(made.note, asked.note);
}
