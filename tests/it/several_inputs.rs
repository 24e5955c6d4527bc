//! Process models of several inputs that act together.

use deadtime::delay::{
    DelayEstimate, DelayEstimator, Experiment, Job, Others, Outcome, P1d, P2d, Process, ProcessModel, Recording, Search,
};
use deadtime::log::{Channel, Log};
use deadtime::signal::{Excitation, excitation::Rbs};
use deadtime::time::SampleTime;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const STEP_S: f64 = 0.1;

fn binary(samples: usize, seed: u64) -> Vec<f64> {
    Rbs::default().generate(samples, &mut ChaCha8Rng::seed_from_u64(seed)).unwrap()
}

/// The sum of what each input does, with noise.
fn output(inputs: &[Vec<f64>], models: &[ProcessModel], noise: f64, seed: u64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let ts = SampleTime::new(STEP_S).unwrap();
    let parts: Vec<Vec<f64>> = inputs.iter().zip(models).map(|(u, m)| m.slopes(u, ts).unwrap().response).collect();
    (0..inputs[0].len())
        .map(|t| {
            let e: f64 = StandardNormal.sample(&mut rng);
            parts.iter().map(|p| p[t]).sum::<f64>() + noise * e
        })
        .collect()
}

fn model(gain: f64, lags_s: &[f64], delay_s: f64) -> ProcessModel {
    ProcessModel { gain, lags_s: lags_s.to_vec(), zero_s: None, delay_s }
}

/// The answer for each input of one output.
fn answers(estimator: &dyn DelayEstimator, inputs: &[Vec<f64>], y: &[f64]) -> Vec<DelayEstimate> {
    let names = (0..inputs.len()).map(|i| format!("u{i}")).collect();
    let recording = Recording { inputs: inputs.iter().map(|u| u.as_slice().into()).collect(), outputs: vec![y.into()], states: Vec::new() };
    let experiment = Experiment::new(SampleTime::new(STEP_S).unwrap(), names, vec!["y".into()], vec![recording]).unwrap();
    (0..inputs.len()).map(|i| estimator.estimate(&experiment.towards(i, 0).unwrap(), &Search::default()).unwrap()).collect()
}

#[test]
fn two_inputs_with_a_fraction_each_are_found_exactly_where_there_is_no_noise() {
    let inputs = [binary(400, 1), binary(400, 2)];
    let delays = [0.15, 0.62];
    for (estimator, lags) in [(&P1d::default() as &dyn DelayEstimator, &[0.8][..]), (&P2d::default(), &[0.8, 0.3])] {
        let y = output(&inputs, &[model(1.0, lags, delays[0]), model(-0.6, lags, delays[1])], 0.0, 3);
        for (answer, truth) in answers(estimator, &inputs, &y).iter().zip(delays) {
            assert!((answer.delay_s.unwrap() - truth).abs() < 1e-5, "{lags:?}: {answer:?}");
            assert!(
                answer.note.as_deref().unwrap().contains("fitted together with one other input of the same poles"),
                "{:?}",
                answer.note
            );
            assert!(!answer.contradicted);
        }
    }
}

#[test]
fn intervals_of_two_inputs_hold_their_delays_and_are_narrower_than_those_of_one_at_a_time() {
    let delays = [0.15, 0.62];
    let (mut inside, mut tried, mut narrower) = (0, 0, 0);
    for seed in 0..20 {
        let inputs = [binary(300, 10 + seed), binary(300, 100 + seed)];
        let y = output(&inputs, &[model(1.0, &[0.8], delays[0]), model(0.8, &[0.8], delays[1])], 0.05, seed);
        let together = answers(&P1d::default(), &inputs, &y);
        let apart = answers(&P1d(Process { others: Others::Apart, ..Process::default() }), &inputs, &y);
        for ((answer, alone), truth) in together.iter().zip(&apart).zip(delays) {
            let [low, high] = answer.ci95_s.unwrap();
            tried += 1;
            inside += usize::from(low <= truth && truth <= high);
            narrower += usize::from(alone.ci95_s.is_none_or(|[from, to]| to - from > 2.0 * (high - low)));
        }
    }
    println!("{inside} of {tried} intervals hold the delay, {narrower} are less than half as wide as those of one input at a time");
    // Of 40 intervals of 95 % fewer than 34 hold the truth once in 500 times.
    assert!(inside >= 34, "{inside} of {tried}");
    assert!(narrower >= 36, "{narrower} of {tried}");
}

#[test]
fn inputs_with_poles_of_their_own_are_told_and_found() {
    let inputs = [binary(800, 5), binary(800, 6)];
    let y = output(&inputs, &[model(1.0, &[0.4], 0.23), model(1.0, &[2.0], 0.57)], 0.02, 7);
    for (answer, truth) in answers(&P1d::default(), &inputs, &y).iter().zip([0.23, 0.57]) {
        assert!(answer.note.as_deref().unwrap().contains("one other input of poles of their own"), "{:?}", answer.note);
        assert!((answer.delay_s.unwrap() - truth).abs() < 0.03, "{answer:?}");
    }
}

#[test]
fn inputs_that_move_together_are_told_apart() {
    let (lead, other) = (binary(600, 31), binary(600, 32));
    // Three samples of four alike: a correlation of about 0.5.
    let follows = lead.iter().zip(&other).enumerate().map(|(t, (a, b))| if t % 4 == 0 { *b } else { *a }).collect();
    let inputs = [lead, follows];
    let y = output(&inputs, &[model(1.0, &[1.2], 0.35), model(-0.6, &[0.8], 0.8)], 0.02, 33);
    for (answer, truth) in answers(&P1d::default(), &inputs, &y).iter().zip([0.35, 0.8]) {
        assert!((answer.delay_s.unwrap() - truth).abs() < 0.03 && !answer.contradicted, "{answer:?}");
    }
}

#[test]
fn an_input_that_does_nothing_has_no_delay_whatever_the_others_do() {
    let inputs = [binary(400, 8), binary(400, 9)];
    let y = output(&inputs, &[model(0.0, &[0.8], 0.3), model(1.0, &[0.8], 0.62)], 0.05, 10);
    let found = answers(&P1d::default(), &inputs, &y);
    assert_eq!(found[0].outcome, Outcome::NotVisible, "{:?}", found[0]);
    assert!((found[1].delay_s.unwrap() - 0.62).abs() < 0.03, "{:?}", found[1]);
}

#[test]
fn the_verdict_counts_process_models_of_several_inputs() {
    let inputs = [binary(600, 21), binary(600, 22)];
    let y = output(&inputs, &[model(1.0, &[0.5, 0.2], 0.15), model(1.0, &[0.5, 0.2], 0.62)], 0.02, 23);
    let time = (0..600).map(|k| STEP_S * f64::from(k)).collect();
    let [a, b] = inputs;
    let channels = vec![Channel::new("a", None, a), Channel::new("b", None, b), Channel::new("y", None, y)];
    let log = Log::new("two.csv", time, channels).unwrap();
    let report = Job::new(vec![log], ["a", "b"], ["y"]).run().unwrap();
    for (pair, truth) in report.pairs.iter().zip([0.15, 0.62]) {
        let p2d = pair.estimates.iter().find(|e| e.method == "p2d").unwrap();
        assert!(p2d.counts(), "{p2d:?}");
        assert!((p2d.delay_s.unwrap() - truth).abs() < 0.01, "{p2d:?}");
        // The others of the verdict see one input at a time.
        let [low, high] = pair.verdict.ci95_s.unwrap();
        assert!((pair.verdict.delay_s.unwrap() - truth).abs() < 0.1 && low <= truth && truth <= high, "{}: {:?}", pair.input, pair.verdict);
    }
}
