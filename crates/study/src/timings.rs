//! Timings of two programs, measured in pairs on one machine: what got slower.
//!
//! Possible errors, and their countermeasures:
//!
//! - *Noise with heavy tails*: other work on the machine makes a run several times as long, in bursts. Nothing is averaged. In the pairs of a bench the test
//!   counts those in which the new program exceeds the margin. With equally fast programs the probability is one half at most in each pair, under any noise, if
//!   the order changes from pair to pair. The count is compared with a binomial (the sign test: Dixon and Mood 1946, doi:10.1080/01621459.1946.10501898).
//! - *False alarms over many benches*: p-values are corrected by Holm (1979), Scandinavian Journal of Statistics 6(2), 65-70. Equally fast programs fail with a probability of
//!   `alpha` at most, all benches together.
//! - *A burst as long as the measurement*: the fastest run of all pairs, which noise can only lengthen, must be slower by the margin too.
//! - *Changes that are nothing*: another layout of the same code moves a bench by some percent, truly and for no reason. A change within the margin does not fail.
//! - *Too few pairs*: where no count at all would be significant, that is an error and no pass.

use std::io::Read;
use std::path::Path;

use serde::{Deserialize, Serialize};
use statrs::distribution::{Binomial, DiscreteCDF};

use super::error::{Error, Result, StudyError};
use super::gate::holm;
use deadtime_signal::stats;

/// The format of the result.
const FORMAT: &str = "deadtime/timings@1";

/// One line of a file of timings: a bench, timed by both programs one after the other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TimedPair {
    /// The bench.
    pub bench: String,
    /// The time of a run with the old program, s.
    pub before_s: f64,
    /// And with the new one.
    pub after_s: f64,
}

/// Pairs of timings.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Timings {
    /// In the order of the file.
    pub pairs: Vec<TimedPair>,
}

/// The limits of a slower bench.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedGate {
    /// Chance that anything fails between programs that are equally fast, all benches together.
    pub alpha: f64,
    /// A time may grow by this share of itself.
    pub margin: f64,
}

impl Default for SpeedGate {
    fn default() -> Self {
        Self { alpha: 0.01, margin: 0.1 }
    }
}

/// How a bench fared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Speed {
    /// Beyond the margin, and not by chance.
    Slower,
    /// The same the other way round.
    Faster,
    /// Neither was shown.
    Same,
}

/// A bench in both programs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Timed {
    /// The bench.
    pub bench: String,
    /// Pairs.
    pub pairs: usize,
    /// Shortest run, before and after, s.
    pub minimum_s: [f64; 2],
    /// Median over the pairs, s.
    pub median_s: [f64; 2],
    /// Median of after/before within the pairs.
    pub ratio: f64,
    /// Pairs in which the new program took longer than the margin allows; and shorter.
    pub beyond: [usize; 2],
    /// Chance of so many anywhere in the comparison between equally fast programs (Holm): slower, faster.
    pub p_value: [f64; 2],
    /// The verdict on the bench.
    pub speed: Speed,
}

/// The result of a gate on speed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SpeedReport {
    /// `deadtime/timings@1`.
    pub format: &'static str,
    /// The chance of a false alarm that was allowed.
    pub alpha: f64,
    /// The share by which a time may grow.
    pub margin: f64,
    /// Every bench, in the order of the file.
    pub benches: Vec<Timed>,
}

impl SpeedReport {
    /// Those that fared so.
    pub fn of(&self, speed: Speed) -> impl Iterator<Item = &Timed> {
        self.benches.iter().filter(move |b| b.speed == speed)
    }
}

impl Timings {
    /// A CSV file with the columns `bench`, `before_s` and `after_s`, a line a pair.
    ///
    /// # Errors
    /// [`StudyError::Results`] naming the line; [`FileError::Io`](deadtime_signal::file::FileError::Io).
    pub fn read(path: &Path) -> Result<Self> {
        let file = std::fs::File::open(path).map_err(|e| Error::io(path, e))?;
        Ok(Self::from_csv(file, path)?)
    }

    fn from_csv(text: impl Read, path: &Path) -> Result<Self, StudyError> {
        let wrong =
            |detail: String| StudyError::Results { path: path.to_owned(), detail: detail.into() };
        let remedy =
            "give a CSV with the columns bench, before_s and after_s, a line a pair of runs";
        let mut pairs = Vec::new();
        for (at, pair) in csv::Reader::from_reader(text).into_deserialize::<TimedPair>().enumerate()
        {
            let pair = pair.map_err(|e| wrong(format!("{e}; {remedy}")))?;
            for (column, value) in [("before_s", pair.before_s), ("after_s", pair.after_s)] {
                if !(value.is_finite() && value > 0.0) {
                    return Err(wrong(format!(
                        "line {}, bench `{}`: {column} is {value}: a run takes some time",
                        at + 2,
                        pair.bench
                    )));
                }
            }
            pairs.push(pair);
        }
        if pairs.is_empty() {
            return Err(wrong(format!("no pairs in it: {remedy}")));
        }
        Ok(Self { pairs })
    }
}

/// P(X ≥ count) of `pairs` throws of a coin.
fn at_least(count: usize, pairs: usize) -> f64 {
    match (count.checked_sub(1), Binomial::new(0.5, pairs as u64)) {
        (Some(below), Ok(coin)) => coin.sf(below as u64),
        _ => 1.0,
    }
}

impl SpeedGate {
    /// Judges pairs.
    ///
    /// # Errors
    /// [`StudyError::Gate`] for options that cannot be, and where a bench has too few pairs for anything to be found.
    pub fn judge(&self, timings: &Timings) -> Result<SpeedReport, StudyError> {
        let Self { alpha, margin } = *self;
        let wrong = |detail: String| Err(StudyError::Gate { detail: detail.into() });
        if !(alpha > 0.0 && alpha < 1.0) {
            return wrong(format!("alpha is {alpha}: give a chance between 0 and 1"));
        }
        if !(margin >= 0.0 && margin.is_finite()) {
            return wrong(format!("margin is {margin}: give 0 or more"));
        }
        let mut names: Vec<&str> = Vec::new();
        let mut groups: Vec<Vec<&TimedPair>> = Vec::new();
        for pair in &timings.pairs {
            match names.iter().position(|n| *n == pair.bench) {
                Some(at) => groups[at].push(pair),
                None => {
                    names.push(&pair.bench);
                    groups.push(vec![pair]);
                }
            }
        }
        let needed = (alpha / groups.len().max(1) as f64).log2().abs().ceil() as usize;
        if let Some((name, few)) = names.iter().zip(&groups).find(|(_, g)| g.len() < needed) {
            return wrong(format!(
                "bench `{name}` has {} pairs: of {} benches no difference is detectable at {} % with fewer than {needed}; time more rounds, fewer benches, or give a larger alpha",
                few.len(),
                groups.len(),
                100.0 * alpha
            ));
        }
        let mut benches: Vec<Timed> =
            names.iter().zip(&groups).map(|(name, group)| self.counted(name, group)).collect();
        for side in [0, 1] {
            let corrected = holm(&benches.iter().map(|b| b.p_value[side]).collect::<Vec<f64>>());
            benches.iter_mut().zip(corrected).for_each(|(b, p)| b.p_value[side] = p);
        }
        for bench in &mut benches {
            let [before, after] = bench.minimum_s;
            bench.speed = if bench.p_value[0] <= alpha && after > before * (1.0 + margin) {
                Speed::Slower
            } else if bench.p_value[1] <= alpha && before > after * (1.0 + margin) {
                Speed::Faster
            } else {
                Speed::Same
            };
        }
        Ok(SpeedReport { format: FORMAT, alpha, margin, benches })
    }

    /// A bench with its counts and their chances, not corrected yet.
    fn counted(&self, name: &str, pairs: &[&TimedPair]) -> Timed {
        let times = |of: fn(&TimedPair) -> f64| pairs.iter().map(|p| of(p)).collect::<Vec<f64>>();
        let (before, after) = (times(|p| p.before_s), times(|p| p.after_s));
        let median = |of: Vec<f64>| stats::median(of).unwrap_or(0.0);
        let least = |of: &[f64]| of.iter().copied().fold(f64::INFINITY, f64::min);
        let longer = |a: f64, b: f64| a > b * (1.0 + self.margin);
        let beyond = [
            pairs.iter().filter(|p| longer(p.after_s, p.before_s)).count(),
            pairs.iter().filter(|p| longer(p.before_s, p.after_s)).count(),
        ];
        Timed {
            bench: name.to_owned(),
            pairs: pairs.len(),
            minimum_s: [least(&before), least(&after)],
            ratio: median(times(|p| p.after_s / p.before_s)),
            median_s: [median(before), median(after)],
            beyond,
            p_value: beyond.map(|count| at_least(count, pairs.len())),
            speed: Speed::Same,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, Pareto, StandardNormal};

    const BENCHES: usize = 60;
    const ROUNDS: usize = 17;

    /// The disturbances of a shared machine. The clock drifts over the whole measurement. Jitter is 3 %. One run in eight is longer by a Pareto share without a
    /// variance. Bursts lengthen a stretch of runs by half, of either program.
    struct Machine {
        rng: ChaCha8Rng,
        wander: f64,
        burst: usize,
    }

    impl Machine {
        fn run(&mut self, true_s: f64) -> f64 {
            let normal = |rng: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(rng) };
            self.wander += 0.002 * normal(&mut self.rng);
            if self.burst == 0 && self.rng.random_bool(0.002) {
                self.burst = self.rng.random_range(20..400);
            }
            self.burst = self.burst.saturating_sub(1);
            let stray = if self.rng.random_bool(0.125) {
                Pareto::new(0.05, 1.2).unwrap().sample(&mut self.rng)
            } else {
                0.0
            };
            let busy = if self.burst > 0 { 1.5 } else { 1.0 };
            true_s * busy * self.wander.exp() * (1.0 + 0.03 * normal(&mut self.rng).abs() + stray)
        }
    }

    /// Rounds of all benches, the two programs changing places from round to round; `slowdown` of some bench of the new one.
    fn measured(seed: u64, slowdown: impl Fn(usize) -> f64) -> Timings {
        let mut machine = Machine { rng: ChaCha8Rng::seed_from_u64(seed), wander: 0.0, burst: 0 };
        let mut pairs = Vec::new();
        for round in 0..ROUNDS {
            let mut times = [vec![0.0; BENCHES], vec![0.0; BENCHES]];
            for side in [round % 2, 1 - round % 2] {
                for (bench, time) in times[side].iter_mut().enumerate() {
                    let base_s = 1e-6 * 1.3_f64.powi(bench as i32);
                    *time = machine.run(base_s * if side == 1 { slowdown(bench) } else { 1.0 });
                }
            }
            pairs.extend((0..BENCHES).map(|b| TimedPair {
                bench: format!("b{b}"),
                before_s: times[0][b],
                after_s: times[1][b],
            }));
        }
        Timings { pairs }
    }

    #[test]
    fn equally_fast_programs_fail_in_fewer_than_one_run_of_a_hundred() {
        const RUNS: u64 = 1000;
        for margin in [0.1, 0.0] {
            let gate = SpeedGate { margin, ..SpeedGate::default() };
            let alarms = |speed| {
                (0..RUNS)
                    .filter(|seed| {
                        gate.judge(&measured(*seed, |_| 1.0)).unwrap().of(speed).count() > 0
                    })
                    .count()
            };
            let (slower, faster) = (alarms(Speed::Slower), alarms(Speed::Faster));
            println!(
                "margin {margin}: of {RUNS} pairs of equal programs {slower} called slower, {faster} faster"
            );
            // Fewer than 1 % of the runs. Without the margin the test alone has a level of 1 %; the limit adds three standard deviations of that count.
            let most = if margin > 0.0 { 9 } else { 20 };
            assert!(slower <= most && faster <= most, "{slower} {faster}");
        }
    }

    #[test]
    fn a_mean_of_times_would_fail_equally_fast_programs() {
        // The reason for the rule: the same machine, judged by the ratio of mean times.
        let naive = |timings: &Timings| {
            (0..BENCHES).any(|b| {
                let of: Vec<&TimedPair> =
                    timings.pairs.iter().filter(|p| p.bench == format!("b{b}")).collect();
                let mean = |f: fn(&TimedPair) -> f64| {
                    of.iter().map(|p| f(p)).sum::<f64>() / of.len() as f64
                };
                mean(|p| p.after_s) > 1.1 * mean(|p| p.before_s)
            })
        };
        let alarms = (0..100).filter(|seed| naive(&measured(*seed, |_| 1.0))).count();
        assert!(alarms > 50, "{alarms} of 100");
    }

    #[test]
    fn a_doubled_loop_in_one_bench_is_named_and_nothing_else() {
        let (mut found, mut others) = (0, 0);
        for seed in 0..200 {
            let report = SpeedGate::default()
                .judge(&measured(5000 + seed, |b| if b == 7 { 2.0 } else { 1.0 }))
                .unwrap();
            found += report.of(Speed::Slower).filter(|b| b.bench == "b7").count();
            others += report.of(Speed::Slower).filter(|b| b.bench != "b7").count();
        }
        println!(
            "a doubled bench of {BENCHES} found in {found} of 200 runs of {ROUNDS} rounds, {others} others"
        );
        assert!(found >= 180 && others <= 2, "{found} {others}");
        // All of them at half the time are faster, each.
        let report = SpeedGate::default().judge(&measured(1, |_| 0.5)).unwrap();
        assert!(
            report.of(Speed::Faster).count() > BENCHES * 8 / 10
                && report.of(Speed::Slower).count() == 0
        );
    }

    #[test]
    fn too_few_pairs_are_no_pass() {
        let mut timings = measured(1, |_| 1.0);
        timings.pairs.truncate(12 * BENCHES);
        let error = SpeedGate::default().judge(&timings).unwrap_err().to_string();
        // 60 benches at 1 %: 2⁻¹³ < 1/6000 < 2⁻¹².
        assert!(error.contains("12 pairs") && error.contains("fewer than 13"), "{error}");
    }

    #[test]
    fn files_that_are_no_timings_are_refused_with_line_and_remedy() {
        let read = |text: &str| {
            Timings::from_csv(text.as_bytes(), Path::new("t.csv")).unwrap_err().to_string()
        };
        for (text, told) in [
            ("", "no pairs"),
            ("bench,before_s,after_s\n", "no pairs"),
            ("bench,before_s\na,1\n", "after_s"),
            ("bench,before_s,after_s\na,1,2\nb,0,1\n", "line 3"),
            ("bench,before_s,after_s\na,1,NaN\n", "after_s is NaN"),
            ("bench,before_s,after_s\na,1,quick\n", "line: 2"),
        ] {
            assert!(read(text).contains(told), "{text}: {}", read(text));
        }
        let whole = Timings::from_csv(
            "bench,round,before_s,after_s\n\"a, b\",1,1e-6,2e-6\n".as_bytes(),
            Path::new("t.csv"),
        )
        .unwrap();
        assert_eq!(
            whole.pairs,
            [TimedPair { bench: "a, b".to_owned(), before_s: 1e-6, after_s: 2e-6 }]
        );
    }
}
