//! One pair: the conditions of its record, every method's estimate, and the verdict.

use super::answers::{MethodAnswer, pair};
use super::asked::{Feedback, Job};
use super::chosen::Ready;
use super::seen::PairView;
use super::words::{
    MAY_BE_AT_ONCE, ahead_note, at_end_note, at_once_in_loop_note, copy_note, held_verdict,
    lead_note, taken_off_note, tied_note,
};
use crate::conditions::{lasts_one_sample, moving_together, of_the_plant, standing_off};
use crate::error::{DelayError, Result};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::Search;
use crate::experiment::{Experiment, Recording, Series};
use crate::feedback::{held_for, lead, open_part, rests};
use crate::finding::Finding;
use crate::inverse::inverse_response;
use crate::method::{Condition, Method, Start};
use crate::process::integrating::integrates;
use crate::process::orders::judge_orders;
use crate::process::shares::Shares;
use crate::report::Pair;
use crate::richness::richness;
use crate::verdict::conclusion::{RecordFacts, Verdict};
use crate::watched;
use crate::window::at_its_end;
use deadtime_identify::Record;
use deadtime_signal::parallel;
use deadtime_signal::progress::HowFar;
use deadtime_signal::stats::NORMAL_95;
use deadtime_signal::time::SampleTime;

/// Progress on a pair after the tests of its record; the methods take the remainder.
const LOOKED: f64 = 0.15;
const ANSWERED: f64 = 0.75;

/// What an estimation of a pair ends with.
pub(super) enum Estimated {
    Pair(Box<Pair>),
    /// The window is too short, and may grow.
    Wider,
    /// The response lasts one sample behind an input that is no command of levels: two sensors of one signal, of relative degree 0.
    TwoSensors,
}

/// One pair of a job.
pub(super) struct OnePair<'a, 'b> {
    pub(super) job: &'b Job,
    /// The pair methods.
    pub(super) methods: &'b [&'b Ready],
    /// The views of the pair for the methods.
    pub(super) seen: PairView<'a>,
    /// The response of the output to each input.
    pub(super) shares: Option<&'b Shares>,
    /// The indices of the input and the output.
    pub(super) names: [usize; 2],
    /// The window may grow.
    pub(super) grows: bool,
    /// The channels are taken for two sensors of one signal.
    pub(super) two_sensors: bool,
    /// Progress of the work on this pair.
    pub(super) far: HowFar,
}

impl OnePair<'_, '_> {
    fn input(&self) -> &str {
        &self.job.inputs[self.names[0]]
    }

    fn output(&self) -> &str {
        &self.job.outputs[self.names[1]]
    }

    /// The pair's estimates and its verdict, or the required change of the search.
    pub(super) fn estimated(&self) -> Result<Estimated> {
        let (input, output) = (self.input(), self.output());
        let mut search = self.seen.search.clone();
        let findings = self.findings()?;
        let closed = findings.iter().any(|f| f.condition == Condition::Feedback);
        if closed {
            // A controller that reacts within the sample would pass for a plant with a direct path.
            search.min_delay = search.bias(0, 0);
        }
        let records = self.seen.one.pair(0, 0)?;
        let mut answers = self.answers(&search, &findings)?;
        let one_step = records.iter().all(Record::is_one_step);
        let others_act = self.seen.freed.is_some();
        if one_step || others_act {
            judge_orders(answers.iter_mut().map(|a| (a.method, &mut a.estimate)));
        }
        self.job.stop.check()?;
        let ts = self.seen.one.sample_time();
        let window_s = ts.to_seconds(search.max_delay as f64);
        let given = answers.iter().map(|a| (a.method, &a.estimate));
        let at_end = at_its_end(given, &findings, window_s);
        if self.grows && !at_end.is_empty() {
            return Ok(Estimated::Wider);
        }
        self.far
            .at(ANSWERED, &format_args!("whether the delay of {output} behind {input} changes"));
        let held =
            if closed && self.job.feedback == Feedback::Auto { held_for(&records) } else { 1 };
        let facts = RecordFacts {
            early_s: self.job.early_s().max(ts.to_seconds(held as f64 - 1.0)),
            direct: self.seen.looped.direct,
            one_step,
            others_act,
        };
        let mut pair = pair(input, output, &answers, findings, ts, &facts);
        if pair.verdict.delay_s.is_some() && !at_end.is_empty() {
            pair.verdict.doubt(&at_end_note(&at_end, window_s, ts));
        }
        let may_be_copy = self.two_sensors || self.may_be_copy(&pair)?;
        // A loop makes the output a copy within the sample, too.
        if may_be_copy && !closed && !self.two_sensors && !rests(&records) {
            return Ok(Estimated::TwoSensors);
        }
        pair.two_sensors = self.two_sensors;
        self.qualify(&mut pair, closed, held, may_be_copy);
        // Between interpolated samples every jump looks like an outlier.
        if self.job.early_s() == 0.0 {
            pair.standing_off = standing_off(&records);
        }
        self.conclude(&mut pair, &search, &records, facts)?;
        self.far.at(1.0, &format_args!("{input} and {output} done"));
        Ok(Estimated::Pair(Box::new(pair)))
    }

    /// Withdraws the verdict where the output leads the input, or where both are tied; else tests whether the delay changes.
    fn conclude(
        &self,
        pair: &mut Pair,
        search: &Search,
        records: &[Record<'_>],
        facts: RecordFacts,
    ) -> Result<()> {
        let (input, output) = (self.input(), self.output());
        // The finite responses of that test are no model of a plant that integrates.
        let integrates = pair.findings.iter().any(|f| f.condition == Condition::Integrating);
        let looked_for = self.job.feedback == Feedback::Auto && !integrates;
        let leads =
            looked_for.then(|| lead(records, search.max_delay, search.bias(0, 0))).flatten();
        // Interpolation makes an output lead by one sample.
        let ahead = self.seen.looped.ahead && self.job.early_s() == 0.0;
        // So does a delay that moves, to a model of one delay.
        let ahead = ahead && watched::stands(self.seen.alone(), search)?;
        if self.seen.looped.tied {
            pair.verdict = Verdict::none(tied_note(input, output));
        } else if let Some(samples) = leads {
            let ts = self.seen.one.sample_time();
            pair.verdict = Verdict::none(lead_note(input, output, samples, ts));
        } else if ahead {
            pair.verdict = Verdict::none(ahead_note(input, output));
        } else {
            let asked = watched::Wanted { track: self.job.track, facts };
            watched::tell(pair, self.seen.alone(), search, self.methods, &asked)?;
        }
        Ok(())
    }

    /// Adds the record's evidence to the verdict of the methods; `held`: the samples for which an input under feedback is held.
    fn qualify(&self, pair: &mut Pair, closed: bool, held: usize, may_be_copy: bool) {
        let ts = self.seen.one.sample_time();
        // A controller within the sample explains a missing dead time, too.
        if closed && !pair.verdict.grounds.direct {
            if at_once(&pair.verdict, ts) {
                pair.verdict = Verdict::none(at_once_in_loop_note(&pair.verdict, ts));
            } else if may_be_at_once(&pair.verdict, ts) {
                pair.verdict.doubt(MAY_BE_AT_ONCE);
            }
        }
        if let Some(delay_s) = pair.verdict.delay_s.filter(|_| may_be_copy) {
            pair.verdict.doubt(&copy_note(delay_s, self.two_sensors, ts));
        }
        if let Some(shares) = self.shares.filter(|_| self.seen.freed.is_some()) {
            let others = shares.of_others(self.names[0]);
            pair.verdict.why.push_str(&taken_off_note(&self.job.inputs, &others));
        }
        if held > 1 {
            pair.verdict = held_verdict(pair.verdict.clone(), self.input(), held, ts);
        }
    }

    /// The response lasts one sample, and the relative degree was assumed: the channels may be two sensors of one signal.
    fn may_be_copy(&self, pair: &Pair) -> Result<bool> {
        let shows = |condition| pair.findings.iter().any(|f| f.condition == condition);
        let assumed = self.job.degree_bias.is_none() && self.job.model.is_none();
        // A copy delayed by a fraction of a sample begins before its command and passes for a loop.
        let open = self.job.feedback != Feedback::Closed && !self.seen.looped.direct;
        // Two sensors of one signal do not integrate each other: a ramp behind a step looks like a response of one sample.
        let finite = !shows(Condition::Integrating);
        if !(assumed && open && finite && pair.verdict.delay_s.is_some()) {
            return Ok(false);
        }
        // With missing outputs the regression behind that condition may have too few rows.
        let short = !shows(Condition::Dynamics) && !shows(Condition::MissingOutputs);
        Ok(short || lasts_one_sample(&self.seen.one.pair(0, 0)?, self.seen.search.max_delay))
    }

    /// The conditions of the record that some methods do not withstand.
    fn findings(&self) -> Result<Vec<Finding>> {
        let (seen, max_delay) = (&self.seen, self.seen.search.max_delay);
        let mut findings = of_the_plant(&seen.alone().pair(0, 0)?, max_delay);
        if self.two_sensors {
            // A fraction of a sample rings, and passes for a lag.
            findings.retain(|f| f.condition != Condition::Dynamics);
            // Without a method that is made for copies the others are no worse than they were.
            if self.methods.iter().any(|r| r.method.withstands(Condition::TwoSensors)) {
                findings.push(Finding {
                    condition: Condition::TwoSensors,
                    evidence: "the response lasts one sample, and the input is of no levels".into(),
                });
            }
        }
        findings.extend(self.job.feedback.said().or_else(|| seen.looped.finding()));
        findings.extend(moving_together(&seen.together, max_delay));
        let open = findings.iter().all(|f| f.condition != Condition::Feedback);
        let integrating =
            if open { integrates(&seen.alone().pair(0, 0)?, max_delay) } else { None };
        if let Some(integrating) = integrating {
            // Side effects of an integrator: a long response, coloured noise, and an estimated pole outside the unit circle.
            findings.retain(|f| {
                !matches!(
                    f.condition,
                    Condition::UnstablePlant | Condition::Dynamics | Condition::ColouredNoise
                )
            });
            findings.push(integrating);
        } else if open {
            let coloured = findings.iter().any(|f| f.condition == Condition::ColouredNoise);
            findings.extend(inverse_response(&seen.alone().pair(0, 0)?, max_delay, coloured));
        }
        self.job.stop.check()?;
        Ok(findings)
    }

    /// Every method's estimate. In a loop, methods without immunity to feedback use the open-loop part of the input.
    fn answers(&self, search: &Search, findings: &[Finding]) -> Result<Vec<MethodAnswer>> {
        let seen = &self.seen;
        let shows = |condition| findings.iter().any(|f| f.condition == condition);
        let closed = shows(Condition::Feedback);
        let open = if closed {
            open_experiment(&seen.one, search.max_delay, search.bias(0, 0))?
        } else {
            None
        };
        let looks: Vec<&Method> = self.methods.iter().map(|r| r.method).collect();
        // Methods without a prediction have none; unusable data is reported by the method's own
        // error.
        let predicted = richness(seen.by_start(Start::Rest), search, &looks)
            .unwrap_or_else(|_| vec![None; looks.len()]);
        // A method for another condition than the record's is omitted, unless only such methods were requested.
        let suits = |r: &Ready| r.method.made_for.is_none_or(shows);
        let any = self.methods.iter().any(|r| suits(r));
        let asked: Vec<(&Ready, _)> = (self.methods.iter().copied().zip(predicted))
            .filter(|(ready, _)| !any || suits(ready))
            .collect();
        let what = format!("answers of methods on {} and {}", self.input(), self.output());
        let answering = self.far.part(LOOKED, ANSWERED);
        let steps = answering.steps(asked.len(), &what);
        let estimate = |ready: &Ready| -> Result<DelayEstimate, DelayError> {
            let method = ready.method;
            if let Some(condition) = method.made_for.filter(|c| !shows(*c)) {
                let note = format!("the record does not show {}", condition.words());
                return Ok(DelayEstimate::without(Outcome::NotApplicable, note));
            }
            match open.as_ref().filter(|_| !method.withstands(Condition::Feedback)) {
                Some(freed) => Ok(ready.estimator.estimate(freed, search)?.of_open_part()),
                None if ready.estimator.is_joint() => {
                    ready.estimator.estimate(seen.all_inputs(method.start), search)
                }
                None => ready.estimator.estimate(seen.by_start(method.start), search),
            }
        };
        let answer = |(ready, predicted): (&Ready, _)| {
            self.job.stop.check()?;
            let answer = MethodAnswer::of(ready, predicted, estimate)?;
            steps.one_more();
            Ok(answer)
        };
        parallel::try_map(asked, answer)
    }
}

/// A dead time below half a sample, or one whose interval holds zero within one standard deviation of the value.
fn at_once(verdict: &Verdict, ts: SampleTime) -> bool {
    let (Some(delay_s), Some([_, to_s])) = (verdict.delay_s, verdict.ci95_s) else { return false };
    let within = may_be_at_once(verdict, ts) && to_s - delay_s > NORMAL_95 * delay_s;
    within || delay_s < 0.5 * ts.seconds()
}

/// An interval that holds a dead time below half a sample.
fn may_be_at_once(verdict: &Verdict, ts: SampleTime) -> bool {
    verdict.ci95_s.is_some_and(|[from_s, _]| from_s < 0.5 * ts.seconds())
}

/// A pair with the open-loop part of the input, where that part is large enough.
fn open_experiment<'a>(
    one: &Experiment<'_>,
    max_delay: usize,
    bias: usize,
) -> Result<Option<Experiment<'a>>> {
    let Some(records) = open_part(&one.pair(0, 0)?, max_delay, bias) else { return Ok(None) };
    let recordings = records.into_iter().map(|r| Recording {
        inputs: vec![r.u],
        outputs: vec![Series { values: r.y, present: None }],
        states: Vec::new(),
    });
    Ok(Some(one.with_recordings(recordings.collect())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::chosen::chosen;
    use crate::method::Scope;
    use crate::report::Report;
    use deadtime_log::{Channel, Log};
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn report(u: Vec<f64>, y: Vec<f64>, feedback: Feedback) -> Report {
        let time_s = (0..u.len()).map(|t| t as f64).collect();
        let channels = vec![Channel::new("u", None, u), Channel::new("y", None, y)];
        let log = Log::new("drawn", time_s, channels).unwrap();
        let names =
            ["arxstruc", "met1struc", "oestruc", "p2d", "gcc_hannan_thomson", "phase_slope"]
                .map(str::to_owned);
        let methods = chosen(&names, &Default::default(), &[Scope::Pair]).unwrap();
        Job { methods, feedback, ..Job::new(vec![log], ["u"], ["y"]) }.run().unwrap()
    }

    fn drawn(seed: u64, pole: f64, delay: usize) -> (Vec<f64>, Vec<f64>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (mut u, mut y, mut x) = (Vec::new(), Vec::new(), 0.0);
        for t in 0..900_usize {
            u.push(StandardNormal.sample(&mut rng));
            x = pole * x + t.checked_sub(delay).map_or(0.0, |at| u[at]);
            let noise: f64 = StandardNormal.sample(&mut rng);
            y.push(x + rng.random_range(0.01..0.1) * noise);
        }
        (u, y)
    }

    fn of_two_sensors(seeds: std::ops::Range<u64>) {
        for seed in seeds {
            let delay = 2 + seed as usize;
            for fraction in [0.0, 0.25, 0.5] {
                let (u, y) = drawn(seed, 0.0, delay);
                let y = deadtime_signal::fractional_delay(&y, fraction);
                let pair = report(u, y, Feedback::Auto).pairs.remove(0);
                let truth = delay as f64 + fraction;
                // A fraction of a sample begins before its command and may pass for a loop.
                if fraction > 0.0 && !pair.two_sensors {
                    let verdict = &pair.verdict;
                    assert!(verdict.delay_s.is_none() || verdict.why.contains("two sensors"));
                    continue;
                }
                let [from, to] = pair.verdict.ci95_s.unwrap();
                assert!(pair.two_sensors && pair.verdict.why.contains("two sensors"));
                assert!(from - 0.02 <= truth && truth <= to + 0.02, "{truth}: {:?}", pair.verdict);
                assert!(to - from < 1.0, "{truth}: {:?}", pair.verdict);
            }
            for pole in [0.6, 0.8, 0.95] {
                let (u, y) = drawn(seed, pole, delay);
                let pair = report(u, y, Feedback::Auto).pairs.remove(0);
                assert!(!pair.two_sensors && !pair.verdict.why.contains("two sensors"));
            }
        }
    }

    #[test]
    fn of_two_sensors_the_relative_degree_is_zero_and_the_other_dead_time_is_given() {
        of_two_sensors(1..2);
    }

    #[test]
    #[ignore = "nightly: more draws"]
    fn of_two_sensors_the_relative_degree_is_zero_and_the_other_dead_time_is_given_in_all_draws() {
        of_two_sensors(2..9);
    }

    #[test]
    fn a_command_of_levels_is_held_and_the_dead_time_between_two_sensors_is_given() {
        for seed in 1..5 {
            let (u, _) = drawn(seed, 0.0, 0);
            let u: Vec<f64> = u.iter().map(|v| v.signum()).collect();
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let noisy = |t: usize| {
                let e: f64 = StandardNormal.sample(&mut rng);
                t.checked_sub(3).map_or(0.0, |at| u[at]) + 0.05 * e
            };
            let y: Vec<f64> = (0..u.len()).map(noisy).collect();
            let pair = report(u, y, Feedback::Auto).pairs.remove(0);
            assert!((pair.verdict.delay_s.unwrap() - 2.0).abs() < 0.6, "{:?}", pair.verdict);
            assert!(!pair.two_sensors && pair.verdict.why.contains("the dead time 3"));
        }
    }

    #[test]
    fn in_a_loop_a_dead_time_within_one_deviation_of_zero_is_refused() {
        let ts = SampleTime::new(1.0).unwrap();
        let of = |delay_s, ci95_s| Verdict {
            delay_s: Some(delay_s),
            ci95_s: Some(ci95_s),
            ..Verdict::none(String::new())
        };
        for (delay_s, ci95_s, refused) in [
            (0.3, [0.25, 0.35], true),
            (0.9, [0.0, 20.0], true),
            (2.0, [0.0, 7.0], true),
            (0.95, [0.0, 2.0], false),
            (5.0, [0.0, 7.0], false),
            (2.0, [1.0, 9.0], false),
        ] {
            assert_eq!(at_once(&of(delay_s, ci95_s), ts), refused, "{delay_s} {ci95_s:?}");
        }
        assert!(!at_once(&Verdict::none(String::new()), ts));
    }

    #[test]
    fn no_dead_time_in_a_loop_is_no_number_and_in_an_open_one_it_is() {
        for seed in 0..3 {
            let (u, y) = drawn(seed, 0.8, 1);
            let open = report(u.clone(), y.clone(), Feedback::Auto).pairs.remove(0).verdict;
            assert!(open.delay_s.is_some_and(|d| d < 0.5), "{open:?}");
            let closed = report(u, y, Feedback::Closed).pairs.remove(0).verdict;
            assert!(closed.delay_s.is_none(), "{closed:?}");
            assert!(closed.why.contains("no direct path"), "{}", closed.why);
        }
    }
}
