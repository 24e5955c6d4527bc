//! Process models of several inputs that act together.

use std::collections::BTreeMap;

use deadtime::delay::report::Pair;
use deadtime::delay::{
    DelayEstimate, DelayEstimator, Experiment, Job, Others, Outcome, P1d, P2d, Process,
    ProcessModel, Recording, Scope, Search, chosen,
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
    let parts: Vec<Vec<f64>> =
        inputs.iter().zip(models).map(|(u, m)| m.slopes(u, ts).unwrap().response).collect();
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
    let recording = Recording {
        inputs: inputs.iter().map(|u| u.as_slice().into()).collect(),
        outputs: vec![y.into()],
        states: Vec::new(),
    };
    let experiment =
        Experiment::new(SampleTime::new(STEP_S).unwrap(), names, vec!["y".into()], vec![recording])
            .unwrap();
    (0..inputs.len())
        .map(|i| {
            estimator.estimate(&experiment.towards(i, 0).unwrap(), &Search::default()).unwrap()
        })
        .collect()
}

#[test]
fn two_inputs_with_a_fraction_each_are_found_exactly_where_there_is_no_noise() {
    let inputs = [binary(400, 1), binary(400, 2)];
    let delays = [0.15, 0.62];
    for (estimator, lags) in
        [(&P1d::default() as &dyn DelayEstimator, &[0.8][..]), (&P2d::default(), &[0.8, 0.3])]
    {
        let y =
            output(&inputs, &[model(1.0, lags, delays[0]), model(-0.6, lags, delays[1])], 0.0, 3);
        for (answer, truth) in answers(estimator, &inputs, &y).iter().zip(delays) {
            assert!((answer.delay_s.unwrap() - truth).abs() < 1e-5, "{lags:?}: {answer:?}");
            assert!(
                answer
                    .note
                    .as_deref()
                    .unwrap()
                    .contains("fitted together with one other input of the same poles"),
                "{:?}",
                answer.note
            );
            assert!(!answer.contradicted);
        }
    }
}

#[test]
#[ignore = "nightly: coverage over draws"]
fn intervals_of_two_inputs_hold_their_delays_and_are_narrower_than_those_of_one_at_a_time() {
    let delays = [0.15, 0.62];
    let (mut inside, mut tried, mut narrower) = (0, 0, 0);
    for seed in 0..20 {
        let inputs = [binary(300, 10 + seed), binary(300, 100 + seed)];
        let y = output(
            &inputs,
            &[model(1.0, &[0.8], delays[0]), model(0.8, &[0.8], delays[1])],
            0.05,
            seed,
        );
        let together = answers(&P1d::default(), &inputs, &y);
        let apart =
            answers(&P1d(Process { others: Others::Apart, ..Process::default() }), &inputs, &y);
        for ((answer, alone), truth) in together.iter().zip(&apart).zip(delays) {
            let [low, high] = answer.ci95_s.unwrap();
            tried += 1;
            inside += usize::from(low <= truth && truth <= high);
            narrower +=
                usize::from(alone.ci95_s.is_none_or(|[from, to]| to - from > 2.0 * (high - low)));
        }
    }
    println!(
        "{inside} of {tried} intervals hold the delay, {narrower} are less than half as wide as those of one input at a time"
    );
    // Of 40 intervals of 95 % fewer than 34 hold the truth once in 500 times.
    assert!(inside >= 34, "{inside} of {tried}");
    assert!(narrower >= 36, "{narrower} of {tried}");
}

#[test]
fn inputs_with_poles_of_their_own_are_told_and_found() {
    let inputs = [binary(800, 5), binary(800, 6)];
    let y = output(&inputs, &[model(1.0, &[0.4], 0.23), model(1.0, &[2.0], 0.57)], 0.02, 7);
    for (answer, truth) in answers(&P1d::default(), &inputs, &y).iter().zip([0.23, 0.57]) {
        assert!(
            answer.note.as_deref().unwrap().contains("one other input of poles of their own"),
            "{:?}",
            answer.note
        );
        assert!((answer.delay_s.unwrap() - truth).abs() < 0.03, "{answer:?}");
    }
}

#[test]
fn inputs_that_move_together_are_told_apart() {
    let (lead, other) = (binary(600, 31), binary(600, 32));
    // Three samples of four alike: a correlation of about 0.5.
    let follows = lead
        .iter()
        .zip(&other)
        .enumerate()
        .map(|(t, (a, b))| if t % 4 == 0 { *b } else { *a })
        .collect();
    let inputs = [lead, follows];
    let y = output(&inputs, &[model(1.0, &[1.2], 0.35), model(-0.6, &[0.8], 0.8)], 0.02, 33);
    for (answer, truth) in answers(&P1d::default(), &inputs, &y).iter().zip([0.35, 0.8]) {
        assert!(
            (answer.delay_s.unwrap() - truth).abs() < 0.03 && !answer.contradicted,
            "{answer:?}"
        );
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

/// The verdict's interval for each input, from methods of several classes.
fn believed(inputs: &[Vec<f64>], y: Vec<f64>) -> Vec<Pair> {
    believed_by(
        &["oestruc", "armaxstruc", "arxstruc", "p1d", "p2d", "threshold", "crosscorr", "arxdap"],
        inputs,
        y,
    )
}

/// The same of chosen methods.
fn believed_by(methods: &[&str], inputs: &[Vec<f64>], y: Vec<f64>) -> Vec<Pair> {
    let time = (0..y.len()).map(|k| STEP_S * f64::from(u32::try_from(k).unwrap())).collect();
    let named =
        inputs.iter().enumerate().map(|(i, u)| Channel::new(format!("u{i}"), None, u.clone()));
    let log =
        Log::new("several.csv", time, named.chain([Channel::new("y", None, y)]).collect()).unwrap();
    let names = (0..inputs.len()).map(|i| format!("u{i}"));
    let methods: Vec<String> = methods.iter().map(|&m| m.to_owned()).collect();
    let methods = chosen(&methods, &BTreeMap::new(), &[Scope::Pair]).unwrap();
    Job { methods, ..Job::new(vec![log], names, ["y"]) }.run().unwrap().pairs
}

/// How many verdicts hold the truth, and how many are narrower than a sample.
fn held(pairs: &[Pair], delays: &[f64], told: &mut [usize; 3]) {
    for (pair, truth) in pairs.iter().zip(delays) {
        let [low, high] = pair.verdict.ci95_s.unwrap_or([f64::NAN; 2]);
        told[0] += 1;
        told[1] += usize::from(low <= *truth && *truth <= high);
        told[2] += usize::from(high - low < STEP_S);
        println!(
            "{} {truth}: {:?} {:?} {}",
            pair.input, pair.verdict.delay_s, pair.verdict.ci95_s, pair.verdict.why
        );
    }
}

/// Noise of first order, a twentieth of whose power is new in each sample.
fn slow(samples: usize, std: f64, seed: u64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut e = 0.0;
    let mut next = || {
        let white: f64 = StandardNormal.sample(&mut rng);
        e = 0.95_f64.sqrt() * e + 0.05_f64.sqrt() * std * white;
        e
    };
    (0..samples).map(|_| next()).collect()
}

#[test]
#[ignore = "nightly: drawn records of two inputs"]
fn verdicts_on_two_inputs_hold_their_fractions_and_are_narrower_than_a_sample() {
    let delays = [0.15, 0.62];
    let mut told = [0; 3];
    for (noise, seeds) in [(0.02, 0..6), (0.05, 6..12)] {
        for seed in seeds {
            let inputs = [binary(600, 1000 + seed), binary(600, 2000 + seed)];
            let y = output(
                &inputs,
                &[model(1.0, &[0.8], delays[0]), model(-0.6, &[0.8], delays[1])],
                noise,
                3000 + seed,
            );
            held(&believed(&inputs, y), &delays, &mut told);
        }
    }
    let [all, inside, narrow] = told;
    println!("{inside} of {all} verdicts hold the dead time, {narrow} are narrower than a sample");
    // Of 24 intervals of 95 % fewer than 20 hold the truth once in 170 times.
    assert!(inside >= 20 && narrow >= 22, "{told:?}");
}

#[test]
#[ignore = "nightly: coverage over draws"]
fn verdicts_on_two_inputs_hold_where_each_has_its_own_poles_or_the_noise_is_slow() {
    let delays = [0.15, 0.62];
    let (mut own, mut coloured) = ([0; 3], [0; 3]);
    for seed in 0..5 {
        let inputs = [binary(600, 4000 + seed), binary(600, 5000 + seed)];
        let y = output(
            &inputs,
            &[model(1.0, &[0.4], delays[0]), model(-0.6, &[1.5, 0.3], delays[1])],
            0.02,
            6000 + seed,
        );
        held(&believed(&inputs, y), &delays, &mut own);
        let y = output(
            &inputs,
            &[model(1.0, &[0.8], delays[0]), model(-0.6, &[0.8], delays[1])],
            0.0,
            0,
        );
        let y = y.iter().zip(slow(600, 0.05, 7000 + seed)).map(|(y, e)| y + e).collect();
        held(&believed(&inputs, y), &delays, &mut coloured);
    }
    println!("poles of their own: {own:?}; slow noise: {coloured:?}");
    // Of 10 intervals of 95 % fewer than 7 hold the truth once in 900 times.
    assert!(own[1] >= 7 && coloured[1] >= 7, "{own:?} {coloured:?}");
}

#[test]
fn an_input_beside_one_that_does_nothing_is_judged_as_if_it_were_alone() {
    let inputs = [binary(600, 41), binary(600, 42)];
    let y = output(&inputs[..1], &[model(1.0, &[0.8], 0.35)], 0.05, 43);
    let (beside, alone) = (believed(&inputs, y.clone()), believed(&inputs[..1], y));
    assert_eq!(beside[0].findings, alone[0].findings);
    for name in ["oestruc", "threshold", "arxdap"] {
        let of = |pair: &Pair| {
            pair.estimates
                .iter()
                .find(|e| e.method == name)
                .map(|e| (e.delay_s, e.ci95_s, e.predicted_std_s))
        };
        assert_eq!(of(&beside[0]), of(&alone[0]), "{name}");
    }
    assert!(!beside[0].verdict.why.contains("taken off"), "{}", beside[0].verdict.why);
}

#[test]
fn what_is_shown_and_expected_of_a_pair_is_free_of_what_other_inputs_do() {
    let inputs = [binary(600, 51), binary(600, 52)];
    let models = [model(1.0, &[0.8], 0.15), model(-0.6, &[0.8], 0.62)];
    let together = believed(&inputs, output(&inputs, &models, 0.02, 53));
    for (i, pair) in together.iter().enumerate() {
        let alone = believed(&inputs[i..=i], output(&inputs[i..=i], &models[i..=i], 0.02, 53));
        let shown = |p: &Pair| p.findings.iter().map(|f| f.condition).collect::<Vec<_>>();
        assert_eq!(shown(pair), shown(&alone[0]), "{}", pair.input);
        let expected = |p: &Pair| {
            p.estimates.iter().find(|e| e.method == "p2d").and_then(|e| e.predicted_std_s).unwrap()
        };
        let ratio = expected(pair) / expected(&alone[0]);
        assert!((0.5..2.0).contains(&ratio), "{}: {ratio}", pair.input);
        assert!(
            pair.verdict.why.contains("were removed for methods that model one input"),
            "{}",
            pair.verdict.why
        );
    }
}

#[test]
#[ignore = "nightly: counts over draws"]
fn the_verdict_counts_process_models_of_several_inputs() {
    let (mut counted, mut near, mut held) = (0, 0, 0);
    for seed in 0..4 {
        let inputs = [binary(600, 21 + 10 * seed), binary(600, 22 + 10 * seed)];
        let y = output(
            &inputs,
            &[model(1.0, &[0.5, 0.2], 0.15), model(1.0, &[0.5, 0.2], 0.62)],
            0.02,
            23 + 10 * seed,
        );
        for (pair, truth) in believed_by(&["all"], &inputs, y).iter().zip([0.15, 0.62]) {
            let p2d = pair.estimates.iter().find(|e| e.method == "p2d").unwrap();
            counted += u32::from(p2d.counts());
            near += u32::from((p2d.delay_s.unwrap() - truth).abs() < 0.01);
            let [low, high] = pair.verdict.ci95_s.unwrap();
            held += u32::from(
                (pair.verdict.delay_s.unwrap() - truth).abs() < 0.1
                    && low <= truth
                    && truth <= high,
            );
        }
    }
    println!("of 8 pairs: {counted} count, {near} near, {held} held");
    // A fit of one parameter more is taken for better by chance: once in 87 (chi-square of one degree above ln 600).
    assert!(counted >= 5 && near == 8 && held >= 7, "{counted} {near} {held}");
}
