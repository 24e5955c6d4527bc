//! Delays that move: a change is seen where there is one and not where there is none, and the tracker says why it raises its voice.

use deadtime::delay::track::{Alarm, Tracker, TrackerOptions, Watch};
use deadtime::delay::{DelayError, Record, Search};
use deadtime::signal::excitation::{Chirp, Doublet, Excitation, Multisine, Rbs, Step};
use deadtime::signal::{Noise, NoiseColour};
use deadtime::time::SampleTime;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

const N: usize = 1000;

fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// Two lags behind a delay that may move, and noise; the command acts `later(t)` samples after the hold's own.
fn response(u: &[f64], later: impl Fn(usize) -> usize, noise: &Noise, seed: u64) -> Vec<f64> {
    let (mut a, mut b, mut y) = (0.0, 0.0, Vec::with_capacity(u.len()));
    for t in 0..u.len() {
        y.push(b);
        let d = later(t);
        b = 0.6 * b + 0.4 * a;
        a = 0.8 * a + 0.2 * if t >= d { u[t - d] } else { 0.0 };
    }
    noise.add(&y, &mut rng(seed)).unwrap()
}

fn coloured(snr: f64) -> Noise {
    Noise { snr, colour: NoiseColour::Ar { coefficients: vec![-0.9] }, ..Noise::default() }
}

fn white(snr: f64) -> Noise {
    Noise { snr, ..Noise::default() }
}

fn rbs(samples: usize, seed: u64) -> Vec<f64> {
    Rbs { band: [0.0, 0.5], ..Rbs::default() }.generate(samples, &mut rng(seed)).unwrap()
}

fn record(u: &[f64], y: &[f64]) -> Record<'static> {
    let centred = |x: &[f64]| -> Vec<f64> {
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        x.iter().map(|v| v - mean).collect()
    };
    Record::new(centred(u), centred(y))
}

#[test]
#[ignore = "nightly: a rate over draws"]
fn a_delay_that_stands_is_not_said_to_move_whatever_moves_the_plant() {
    let again = |short: Vec<f64>| (0..N).map(|k| short[k % short.len()]).collect::<Vec<f64>>();
    let mut said = Vec::new();
    for seed in 0..4 {
        let mut r = rng(seed);
        let inputs = [
            ("rbs", rbs(N, seed)),
            ("multisine", Multisine::default().generate(N, &mut r).unwrap()),
            ("chirp", Chirp::default().generate(N, &mut r).unwrap()),
            ("doublets", again(Doublet::default().generate(250, &mut r).unwrap())),
            ("steps", again(Step::default().generate(250, &mut r).unwrap())),
        ];
        for (name, u) in inputs {
            for noise in [white(10.0), coloured(10.0), white(1e4)] {
                let y = response(&u, |_| 6, &noise, seed + 100);
                let seen = Watch::default().look(&[record(&u, &y)], &Search::default()).unwrap();
                if !seen.is_steady() {
                    said.push(name);
                }
            }
        }
    }
    assert!(said.is_empty(), "{said:?}");
}

#[test]
fn a_jump_is_seen_at_its_time_and_by_its_size() {
    for (before, behind) in [(4, 6), (4, 9), (13, 4)] {
        for seed in 0..5 {
            let u = rbs(N, seed);
            let y =
                response(&u, |t| if t < 400 { before } else { behind }, &coloured(10.0), seed + 50);
            let seen = Watch::default().look(&[record(&u, &y)], &Search::default()).unwrap();
            let found = seen.stretches();
            assert_eq!(found.len(), 2, "{before} to {behind}, seed {seed}: {found:?}");
            assert_eq!(
                found[1].delay as i64 - found[0].delay as i64,
                behind as i64 - before as i64,
                "seed {seed}: {found:?}"
            );
            let [from, to] = found[1].began.unwrap();
            assert!(from <= 404 && to + 3 >= 400, "the jump at 400 lies in {from} to {to}");
        }
    }
}

#[test]
fn a_change_while_nothing_moves_is_open_between_two_motions() {
    let mut u = rbs(N, 3);
    u[400..600].fill(1.0);
    let y = response(&u, |t| if t < 500 { 4 } else { 10 }, &white(100.0), 7);
    let seen = Watch::default().look(&[record(&u, &y)], &Search::default()).unwrap();
    let [from, to] = seen.stretches()[1].began.unwrap();
    assert!(
        from < 450 && to > 580,
        "nothing moved from 450 to 600, and the change is said to lie in {from} to {to}"
    );
}

#[test]
fn records_with_delays_of_their_own_are_told_apart() {
    let (u, v) = (rbs(600, 1), rbs(600, 2));
    let records = [
        record(&u, &response(&u, |_| 4, &white(30.0), 3)),
        record(&v, &response(&v, |_| 9, &white(30.0), 4)),
    ];
    let found = Watch::default().look(&records, &Search::default()).unwrap().stretches();
    assert_eq!(found.iter().map(|s| s.record).collect::<Vec<_>>(), [0, 1], "{found:?}");
    assert_eq!(found[1].delay - found[0].delay, 5);
    assert!(found[1].began.is_none(), "a record begins where it begins");
}

#[test]
fn the_track_follows_a_drift() {
    let u = rbs(2000, 5);
    let y = response(&u, |t| 4 + t / 200, &white(30.0), 6);
    let seen = Watch::default().look(&[record(&u, &y)], &Search::default()).unwrap();
    let track = seen.track();
    let off: Vec<f64> =
        track.at.iter().zip(&track.mean).map(|((_, t), d)| d - (4 + t / 200) as f64).collect();
    let middle = off.iter().sum::<f64>() / off.len() as f64;
    let rms = (off.iter().map(|d| (d - middle).powi(2)).sum::<f64>() / off.len() as f64).sqrt();
    assert!(rms < 0.5, "the track lies {rms} samples off");
    let drift = seen.drift(&track, 15.0).unwrap();
    assert!((drift.rate - 0.005).abs() < 0.0005, "{drift:?}");
}

#[test]
fn missing_outputs_and_short_records_are_no_change() {
    let u = rbs(N, 8);
    let mut gaps = record(&u, &response(&u, |_| 5, &white(30.0), 9));
    gaps.present = Some((0..N).map(|t| t % 17 != 0).collect());
    // One row in two sees a missing sample; what is left says what the whole would.
    assert!(
        Watch::default().look(&[gaps], &Search::default()).is_some_and(|seen| seen.is_steady())
    );
    let short = record(&u[..100], &response(&u[..100], |_| 5, &white(30.0), 9));
    assert!(Watch::default().look(&[short], &Search::default()).is_none());
}

/// Alarms of a run, and what was told last.
fn run(u: &[f64], y: impl Fn(usize) -> Option<f64>) -> (Vec<Alarm>, Option<f64>, Option<[f64; 2]>) {
    let mut tracker =
        Tracker::new(SampleTime::new(0.01).unwrap(), TrackerOptions::default()).unwrap();
    let (mut alarms, mut last) = (Vec::new(), (None, None));
    for (t, u) in u.iter().enumerate() {
        let told = tracker.push(*u, y(t)).unwrap();
        alarms.extend(told.alarm);
        last = (told.delay_s, told.band_s);
    }
    (alarms, last.0, last.1)
}

#[test]
fn a_tracker_tells_of_a_jump_and_of_nothing_else() {
    let u = rbs(3000, 11);
    let still = response(&u, |_| 5, &coloured(10.0), 12);
    let (alarms, delay, band) = run(&u, |t| Some(still[t]));
    assert!(alarms.is_empty(), "{alarms:?}");
    let ([low, high], delay) = (band.unwrap(), delay.unwrap());
    // Two lags in sampled form answer two samples after the command: one is the assumed relative degree, one is left beside the five.
    assert!(
        low <= 0.06 && high >= 0.06 && (delay - 0.06).abs() < 0.005,
        "{delay} in {low} to {high}"
    );
    let jumps = response(&u, |t| if t < 2000 { 5 } else { 9 }, &coloured(10.0), 12);
    let (alarms, delay, _) = run(&u, |t| (t % 13 != 0).then(|| jumps[t]));
    let [Alarm::DelayChanged { from_s, to_s, since_s }] = alarms[..] else { panic!("{alarms:?}") };
    assert!((to_s - from_s - 0.04).abs() < 1e-9 && (since_s - 20.0).abs() < 0.5, "{alarms:?}");
    assert!((delay.unwrap() - to_s).abs() < 0.006);
}

#[test]
fn a_tracker_tells_a_plant_that_changed_from_a_delay_that_did() {
    let u = rbs(3000, 21);
    let before = response(&u, |_| 5, &white(100.0), 22);
    let (alarms, _, _) = run(&u, |t| Some(if t < 2000 { before[t] } else { -3.0 * before[t] }));
    assert!(
        matches!(alarms[..], [Alarm::ResponseChanged { since_s }, ..] if (since_s - 20.0).abs() < 0.5),
        "{alarms:?}"
    );
}

#[test]
fn a_tracker_says_nothing_of_a_delay_that_nothing_shows() {
    let noise = white(1.0).add(&rbs(2000, 31), &mut rng(32)).unwrap();
    let (alarms, delay, _) = run(&vec![0.5; 2000], |t| Some(noise[t]));
    assert!(alarms.is_empty() && delay.is_none());
}

#[test]
fn a_tracker_refuses_what_is_no_number_and_goes_on() {
    let mut tracker =
        Tracker::new(SampleTime::new(0.01).unwrap(), TrackerOptions::default()).unwrap();
    assert!(matches!(
        tracker.push(f64::NAN, Some(0.0)),
        Err(DelayError::NotFinite { role: "input", .. })
    ));
    assert!(matches!(
        tracker.push(0.0, Some(f64::INFINITY)),
        Err(DelayError::NotFinite { role: "output", .. })
    ));
    assert!(tracker.push(0.0, None).is_ok());
    for wrong in [
        TrackerOptions { na: 0, ..TrackerOptions::default() },
        TrackerOptions { max_delay: 0, ..TrackerOptions::default() },
        TrackerOptions { learn: 10, ..TrackerOptions::default() },
        TrackerOptions { forget: 1, ..TrackerOptions::default() },
        TrackerOptions { alarm: f64::NAN, ..TrackerOptions::default() },
    ] {
        let refused = Tracker::new(SampleTime::new(0.01).unwrap(), wrong.clone());
        assert!(matches!(refused, Err(DelayError::Option { method: "tracker", .. })), "{wrong:?}");
    }
}

/// What a tracker keeps does not grow with what it has seen: neither while it follows nor where it learns anew again and again.
#[test]
fn a_tracker_needs_no_more_memory_however_long_it_runs() {
    let u = rbs(3000, 21);
    let follows = response(&u, |_| 5, &coloured(10.0), 22);
    let mut tracker =
        Tracker::new(SampleTime::new(0.01).unwrap(), TrackerOptions::default()).unwrap();
    let mut push = |rounds: usize, turn: bool| {
        let all = || {
            for round in 0..rounds {
                // Another plant in every round: the response is learnt anew.
                let sign = if turn && round % 2 == 1 { -3.0 } else { 1.0 };
                for (u, y) in u.iter().zip(&follows) {
                    tracker.push(*u, Some(sign * y)).unwrap();
                }
            }
        };
        allocation_counter::measure(all)
    };
    push(2, true);
    for turn in [false, true] {
        let few = push(2, turn);
        let many = push(20, turn);
        assert!(
            many.bytes_max <= few.bytes_max.max(1 << 20),
            "{} bytes in 20 rounds, {} in 2",
            many.bytes_max,
            few.bytes_max
        );
        // What is left behind of ten times as many samples is no more than one learnt response.
        assert!(many.bytes_current.abs() < 1 << 20, "{} bytes are left", many.bytes_current);
    }
}
