//! How often a delay that stands is said to move, how often one that jumps is seen, and how often a track holds the truth: tables in Markdown, by excitation.
//!
//! `cargo run --release --package deadtime-lab --bin track_study -- [DRAWS] [FIRST SEED]`; `lab/study track` writes them into the documents.

use std::collections::BTreeMap;
use std::error::Error;
use std::ops::Range;

use deadtime::delay::track::{Alarm, Tracker, TrackerOptions, Watch};
use deadtime::delay::{Job, Record, Scope, Search, chosen};
use deadtime::log::{Channel, Log};
use deadtime::signal::excitation::EXCITATIONS;
use deadtime::signal::{Noise, NoiseColour};
use deadtime::time::SampleTime;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Sample time, s.
const TS: f64 = 0.01;
/// Steps of the integration within a sample.
const FINE: usize = 10;
/// Samples of a record, and of a machine that runs.
const RECORD: usize = 1000;
const RUN: usize = 3000;
/// Samples after which an excitation of fixed shape is given again.
const AGAIN: usize = 250;
const COLOURS: usize = 3;
const PLANTS: usize = 4;

/// A lag, two lags, a resonance of random parameters, or nearly a copy; integrated by classical Runge-Kutta steps, apart from the crate's own simulation.
fn respond(plant: usize, u: &[f64], delay: impl Fn(f64) -> f64, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let (p, q): (f64, f64) = match plant {
        0 => (rng.random_range(2.0..6.0), 0.0),
        1 => (rng.random_range(3.0..8.0), rng.random_range(1.0..3.0)),
        2 => (rng.random_range(0.15..0.5), rng.random_range(0.1..0.5)),
        _ => (0.3, 0.0),
    };
    let slope = |x: [f64; 2], w: f64| -> [f64; 2] {
        match plant {
            1 => [(x[1] - x[0]) / q, (w - x[1]) / p],
            2 => [x[1], p * p * (w - x[0]) - 2.0 * q * p * x[1]],
            _ => [(w - x[0]) / p, 0.0],
        }
    };
    let h = 1.0 / FINE as f64;
    let mut x = [u[0], if plant == 1 { u[0] } else { 0.0 }];
    let mut y = Vec::with_capacity(u.len());
    for k in 0..u.len() {
        y.push(x[0]);
        for i in 0..FINE {
            let t = k as f64 + (i as f64 + 0.5) * h;
            let from = (t - delay(t)).floor().max(0.0) as usize;
            let w = u[from.min(u.len() - 1)];
            let add = |a: [f64; 2], b: [f64; 2], s: f64| [a[0] + s * b[0], a[1] + s * b[1]];
            let k1 = slope(x, w);
            let k2 = slope(add(x, k1, 0.5 * h), w);
            let k3 = slope(add(x, k2, 0.5 * h), w);
            let k4 = slope(add(x, k3, h), w);
            for j in 0..2 {
                x[j] += h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]);
            }
        }
    }
    y
}

fn colour(number: usize) -> NoiseColour {
    match number {
        0 => NoiseColour::White,
        1 => NoiseColour::Ar { coefficients: vec![-0.9] },
        _ => NoiseColour::Arma { ar: vec![-1.5, 0.8], ma: vec![0.3] },
    }
}

/// An excitation by its name, given again and again where its shape is fixed; `None` where it cannot be that long.
fn excite(name: &str, samples: usize, rng: &mut ChaCha8Rng) -> Option<Vec<f64>> {
    let entry = EXCITATIONS.iter().find(|e| e.name == name)?;
    let options = if name == "prbs" {
        serde_json::json!({ "order": 9, "clock": 3 })
    } else {
        serde_json::json!({})
    };
    let signal = entry.with(options).ok()?;
    let fixed = ["two_ramps", "impulse", "step", "staircase", "doublet", "three_two_one_one"]
        .contains(&name);
    let short = signal.generate(if fixed { AGAIN } else { RECORD }, rng).ok()?;
    Some((0..samples).map(|k| short[k % short.len()]).collect())
}

/// A command and its noisy response, whose delay jumps at `at` by `jump` samples; the delay before it and the samples that it jumps.
fn draw(
    name: &str,
    samples: usize,
    case: (usize, usize),
    snr: f64,
    jump: f64,
    at: f64,
    rng: &mut ChaCha8Rng,
) -> Option<(Vec<f64>, Vec<f64>, f64)> {
    let u = excite(name, samples, rng)?;
    let delay = rng.random_range(2.0..15.0);
    let by = if rng.random_bool(0.5) && delay >= jump { -jump } else { jump };
    let y = respond(case.0, &u, |t| if t < at { delay } else { delay + by }, rng);
    let y = Noise { snr, colour: colour(case.1), ..Noise::default() }.add(&y, rng).ok()?;
    Some((u, y, by))
}

fn without_mean(x: &[f64]) -> Vec<f64> {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    x.iter().map(|v| v - mean).collect()
}

/// The time of the first change that a record is said to have, samples, and by how much.
fn first_change(u: &[f64], y: &[f64]) -> Option<(f64, f64)> {
    let record = [Record::new(without_mean(u), without_mean(y))];
    let seen = Watch::default().look(&record, &Search::default())?;
    let stretches = seen.stretches();
    let [before, behind] = stretches.get(..2)? else { return None };
    Some((behind.samples.start as f64 - 1.0, behind.delay as f64 - before.delay as f64))
}

/// Alarms, and whether anything was learnt.
type Raised = (Vec<(usize, f64)>, bool);

/// Every alarm of a machine that runs: its sample, and by how much the delay is said to change (not a number: the response changed).
fn alarms(u: &[f64], y: &[f64]) -> Result<Raised, Box<dyn Error>> {
    let mut tracker = Tracker::new(SampleTime::new(TS)?, TrackerOptions::default())?;
    let (mut found, mut learnt) = (Vec::new(), false);
    for (k, (u, y)) in u.iter().zip(y).enumerate() {
        let told = tracker.push(*u, Some(*y))?;
        learnt |= told.delay_s.is_some();
        match told.alarm {
            Some(Alarm::DelayChanged { from_s, to_s, .. }) => found.push((k, (to_s - from_s) / TS)),
            Some(Alarm::ResponseChanged { .. }) => found.push((k, f64::NAN)),
            None => {}
        }
    }
    Ok((found, learnt))
}

fn percent(part: usize, of: usize) -> String {
    if of == 0 {
        "–".to_owned()
    } else {
        format!("{:.1} % of {of}", 100.0 * part as f64 / of as f64)
    }
}

/// How a delay moves: its name, and the samples that it is later at a share of the record.
type Motion = (&'static str, fn(f64) -> f64);

/// Motions of which tracks are made.
const MOTIONS: [Motion; 5] = [
    ("stands", |_| 0.0),
    ("jumps by 2 samples", |t| if t < 0.5 { 0.0 } else { 2.0 }),
    ("jumps by 6 samples", |t| if t < 0.4 { 0.0 } else { 6.0 }),
    ("jumps by 6 samples and back", |t| if (0.3..0.7).contains(&t) { 6.0 } else { 0.0 }),
    ("drifts by 8 samples", |t| 8.0 * t),
];

/// Share of the samples at which the track's band holds the truth, and whether the record is said to be what it is; through the whole estimation.
fn held(
    u: &[f64],
    y: &[f64],
    truth: impl Fn(f64) -> f64,
) -> Result<Option<(f64, bool)>, Box<dyn Error>> {
    let time_s = (0..u.len()).map(|k| TS * k as f64).collect();
    let channels = vec![Channel::new("u", None, u.to_vec()), Channel::new("y", None, y.to_vec())];
    let names = ["oestruc", "oe_posterior", "arxstruc", "p2d"].map(str::to_owned);
    let methods = chosen(&names, &BTreeMap::new(), &[Scope::Pair])?;
    let job = Job {
        methods,
        track: true,
        ..Job::new(vec![Log::new("draw", time_s, channels)?], ["u"], ["y"])
    };
    let report = job.run()?;
    let Some(pair) = report.pairs.first() else { return Ok(None) };
    let Some(track) = &pair.track else { return Ok(None) };
    let inside = |i: &usize| {
        let d = TS * truth(track.time_s[*i] / TS);
        track.low_s[*i] <= d + 1e-9 && d <= track.high_s[*i] + 1e-9
    };
    let count = track.time_s.len();
    let moves =
        truth(0.0) != truth(u.len() as f64 - 1.0) || truth(0.0) != truth(u.len() as f64 / 2.0);
    Ok(Some((
        (0..count).filter(inside).count() as f64 / count.max(1) as f64,
        pair.moving.is_some() == moves,
    )))
}

/// Tracks of every motion.
fn bands(draws: u64, first: u64, cases: &[(usize, usize)]) -> Result<(), Box<dyn Error>> {
    println!(
        "## Tracks\n\nThe share of samples at which the 95 % band of `estimate --track` holds the true dead time, and that of records whose delay is rightly said to move or to"
    );
    println!("stand: records of {RECORD} samples, signal-to-noise ratios of 10 and 100.\n");
    println!(
        "| excitation | the delay | in the band | rightly said | records |\n| --- | --- | ---: | ---: | ---: |"
    );
    let mut all = (0.0, 0.0);
    for name in ["rbs", "prbs", "multisine", "chirp", "doublet", "three_two_one_one"] {
        for (motion, later) in MOTIONS {
            let (mut share, mut right, mut count) = (0.0, 0.0, 0.0);
            for seed in first..first + draws {
                for &case in cases {
                    for snr in [10.0, 100.0] {
                        let mut rng = ChaCha8Rng::seed_from_u64(
                            1000 * seed + 10 * case.0 as u64 + case.1 as u64,
                        );
                        let Some(u) = excite(name, RECORD, &mut rng) else { continue };
                        let delay = rng.random_range(2.0..15.0);
                        let truth = |t: f64| delay + later(t / RECORD as f64);
                        let y = respond(case.0, &u, truth, &mut rng);
                        let y = Noise { snr, colour: colour(case.1), ..Noise::default() }
                            .add(&y, &mut rng)?;
                        if let Some((held, said)) = held(&u, &y, truth)? {
                            share += held;
                            right += f64::from(u8::from(said));
                            count += 1.0;
                        }
                    }
                }
            }
            println!(
                "| {name} | {motion} | {:.1} % | {:.1} % | {count} |",
                100.0 * share / count,
                100.0 * right / count
            );
            all = (all.0 + share, all.1 + count);
        }
    }
    println!("| all | | {:.1} % | | {} |", 100.0 * all.0 / all.1, all.1);
    Ok(())
}

/// The random numbers of a draw.
fn random(seed: u64, case: (usize, usize)) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(1000 * seed + 10 * case.0 as u64 + case.1 as u64)
}

/// Counts of delays that stand: records, records said to change, runs, runs with an alarm, and runs in which nothing was learnt.
fn standing_counts(
    name: &str,
    seeds: Range<u64>,
    cases: &[(usize, usize)],
) -> Result<[usize; 5], Box<dyn Error>> {
    let mut count = [0; 5];
    for seed in seeds {
        for &case in cases {
            for snr in [10.0, 100.0, 1e4] {
                let mut rng = random(seed, case);
                if let Some((u, y, _)) = draw(name, RECORD, case, snr, 0.0, 0.0, &mut rng) {
                    count[0] += 1;
                    count[1] += usize::from(first_change(&u, &y).is_some());
                }
                if let Some((u, y, _)) = draw(name, RUN, case, snr, 0.0, 0.0, &mut rng) {
                    let (found, learnt) = alarms(&u, &y)?;
                    count[2] += 1;
                    count[3] += usize::from(!found.is_empty());
                    count[4] += usize::from(!learnt);
                }
            }
        }
    }
    Ok(count)
}

/// The table of delays that stand, by excitation.
fn standing(seeds: &Range<u64>, cases: &[(usize, usize)]) -> Result<(), Box<dyn Error>> {
    println!(
        "## A delay that stands\n\nRecords of {RECORD} samples said to have a delay that changes, and runs of {RUN} samples with an alarm (of a delay or of a response that"
    );
    println!(
        "changed), by excitation, over four kinds of plant, three colours of noise and signal-to-noise ratios of 10, 100 and 10 000.\n"
    );
    println!(
        "| excitation | record | run | runs in which nothing could be learnt |\n| --- | ---: | ---: | ---: |"
    );
    let mut total = [0; 4];
    for entry in EXCITATIONS {
        let count = standing_counts(entry.name, seeds.clone(), cases)?;
        println!(
            "| {} | {} | {} | {} |",
            entry.name,
            percent(count[1], count[0]),
            percent(count[3], count[2]),
            percent(count[4], count[2])
        );
        total.iter_mut().zip(count).for_each(|(t, c)| *t += c);
    }
    println!("| all | {} | {} | |\n", percent(total[1], total[0]), percent(total[3], total[2]));
    Ok(())
}

/// A second, samples.
const SECOND: f64 = 1.0 / TS;

/// The results for delays that jump.
#[derive(Default)]
struct Jumps {
    /// Records, jumps seen in them, runs, and alarms in time.
    count: [usize; 4],
    /// Distances in time of the jumps seen in records, samples.
    off: Vec<f64>,
    /// Waits for the alarms, samples.
    wait: Vec<f64>,
}

impl Jumps {
    /// Adds a record whose delay jumps at `at` by `by`.
    fn add_record(&mut self, (u, y, by): &(Vec<f64>, Vec<f64>, f64), at: f64) {
        self.count[0] += 1;
        if let Some((when, _)) = first_change(u, y)
            .filter(|(when, change)| (when - at).abs() <= SECOND && (change - by).abs() <= 2.0)
        {
            self.count[1] += 1;
            self.off.push((when - at).abs());
        }
    }

    /// Adds a machine that runs and whose delay jumps at `at` by `by`.
    fn add_run(
        &mut self,
        (u, y, by): &(Vec<f64>, Vec<f64>, f64),
        at: f64,
    ) -> Result<(), Box<dyn Error>> {
        self.count[2] += 1;
        let (found, _) = alarms(u, y)?;
        let after = found
            .iter()
            .find(|(k, _)| *k as f64 >= at)
            .filter(|(k, change)| *k as f64 <= at + SECOND && (change - by).abs() <= 2.0);
        if let Some((k, _)) = after {
            self.count[3] += 1;
            self.wait.push(*k as f64 - at);
        }
        Ok(())
    }
}

/// Records and runs of one excitation whose delay jumps by this number of samples.
fn jumps(
    name: &str,
    jump: f64,
    seeds: Range<u64>,
    cases: &[(usize, usize)],
) -> Result<Jumps, Box<dyn Error>> {
    let mut found = Jumps::default();
    for seed in seeds {
        for &case in cases {
            let mut rng = random(seed, case);
            let at = RECORD as f64 * rng.random_range(0.3..0.7);
            if let Some(drawn) = draw(name, RECORD, case, 10.0, jump, at, &mut rng) {
                found.add_record(&drawn, at);
            }
            let at = RUN as f64 * rng.random_range(0.5..0.7);
            if let Some(drawn) = draw(name, RUN, case, 10.0, jump, at, &mut rng) {
                found.add_run(&drawn, at)?;
            }
        }
    }
    Ok(found)
}

/// The median of a list, in words.
fn middle(mut list: Vec<f64>) -> String {
    list.sort_by(f64::total_cmp);
    list.get(list.len() / 2).map_or("–".to_owned(), |m| format!("{m:.0}"))
}

/// The table of delays that jump, by excitation and size.
fn jumping(seeds: &Range<u64>, cases: &[(usize, usize)]) -> Result<(), Box<dyn Error>> {
    println!(
        "## A delay that jumps\n\nAt a signal-to-noise ratio of 10 and a sample time of {TS} s: jumps that are seen at the right time to within a second and by the right amount to within"
    );
    println!(
        "two samples; the median distance in time; runs with an alarm within a second of the jump, and the median wait for it.\n"
    );
    println!(
        "| excitation | jump (samples) | record | off (samples) | run | wait (samples) |\n| --- | ---: | ---: | ---: | ---: | ---: |"
    );
    let mut rich = [0; 4];
    for entry in EXCITATIONS {
        for jump in [2.0, 3.0, 5.0, 10.0] {
            let Jumps { count, off, wait } = jumps(entry.name, jump, seeds.clone(), cases)?;
            println!(
                "| {} | {jump} | {} | {} | {} | {} |",
                entry.name,
                percent(count[1], count[0]),
                middle(off),
                percent(count[3], count[2]),
                middle(wait)
            );
            if ["rbs", "prbs"].contains(&entry.name) {
                rich.iter_mut().zip(count).for_each(|(t, c)| *t += c);
            }
        }
    }
    println!(
        "| rbs and prbs, all jumps | | {} | | {} | |\n",
        percent(rich[1], rich[0]),
        percent(rich[3], rich[2])
    );
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let draws: u64 = arguments.next().map_or(Ok(10), |a| a.parse())?;
    let first: u64 = arguments.next().map_or(Ok(1_000_000), |a| a.parse())?;
    let cases: Vec<(usize, usize)> =
        (0..PLANTS).flat_map(|p| (0..COLOURS).map(move |c| (p, c))).collect();
    standing(&(first..first + draws), &cases)?;
    jumping(&(first..first + draws), &cases)?;
    bands(draws.div_ceil(10), first, &cases)
}
