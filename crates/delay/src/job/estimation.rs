//! An estimation on logs: set up, and run on every pair.

use super::asked::{Job, whole};
use super::chosen::Ready;
use super::pair::{Estimated, OnePair};
use super::seen::PairView;
use crate::error::{DelayError, Result};
use crate::estimator::Search;
use crate::evidence::{Evidence, evidence, impulse_response};
use crate::experiment::{Experiment, recordings};
use crate::feedback::InLoop;
use crate::method::{Method, Scope, Start};
use crate::process::shares::Shares;
use crate::report::{Bias, FORMAT, Pair, Report, Response, Searched};
use crate::richness::{Richness, richness};
use crate::window::{most, reaching, reaching_by_model};
use deadtime_log::Log;
use deadtime_signal::time::SampleTime;

impl Job {
    /// Estimates every pair by every method.
    ///
    /// # Errors
    /// Unusable channels, model or options; [`crate::error::Error::Stopped`]. A method that cannot use the data gives an outcome.
    pub fn run(&self) -> Result<Report> {
        let (logged, search, bias) = self.prepared()?;
        let ts = logged.sample_time();
        let experiment = self.detrended(&logged)?;
        let (mut pairs, longest) = self.pairs(&logged, &experiment, &search)?;
        if let Some(model) = &self.model {
            pairs.extend(self.inputs_by_state(model, ts, &search)?);
        }
        let samples = self.logs.iter().map(Log::len).sum();
        let searched =
            Searched::Samples { samples, records: self.logs.len(), bias, early_s: self.early_s() };
        let max_delay_s = ts.to_seconds(longest as f64);
        Ok(Report {
            format: FORMAT,
            log: self.name.clone(),
            sample_time_s: ts.seconds(),
            max_delay_s,
            pairs,
            searched,
        })
    }

    /// The impulse responses of a report's pairs, where the inputs allow them.
    ///
    /// # Errors
    /// As [`impulse_response`].
    pub fn responses(&self, report: &Report) -> Result<Vec<Option<Response>>> {
        let response = |pair: &Pair| match pair.output.as_str() {
            "*" => Ok(None),
            output => impulse_response(&self.logs, &pair.input, output, self.detrend),
        };
        report.pairs.iter().map(response).collect()
    }

    /// The curves behind the methods, for each pair of a report; `None` for pairs of an input and all states.
    ///
    /// # Errors
    /// As [`evidence`].
    pub fn evidence(&self, report: &Report) -> Result<Vec<Option<Evidence>>> {
        let max_delay = (report.max_delay_s / report.sample_time_s).round() as usize;
        let of = |pair: &Pair| match pair.output.as_str() {
            "*" => Ok(None),
            output => evidence(&self.logs, &pair.input, output, self.detrend, max_delay).map(Some),
        };
        report.pairs.iter().map(of).collect()
    }

    /// The predicted accuracy of each pair method, before any runs: for each pair, outputs first, one line a method.
    ///
    /// # Errors
    /// As [`Job::run`].
    pub fn expected(&self) -> Result<Vec<Expected>> {
        let (logged, search, _) = self.prepared()?;
        let experiment = self.detrended(&logged)?;
        let methods: Vec<&Method> =
            self.methods.iter().map(|r| r.method).filter(|m| m.scope == Scope::Pair).collect();
        self.each_pair(&logged, &experiment, &search, |seen, _, [i, o]| {
            let seen = seen()?;
            let predicted = richness(seen.by_start(Start::Rest), &seen.search, &methods)?;
            let methods = methods.iter().map(|m| m.entry.name).zip(predicted).collect();
            let (input, output) = (self.inputs[i].clone(), self.outputs[o].clone());
            Ok(Expected { input, output, methods })
        })
    }

    fn in_log(&self) -> impl Fn(DelayError) -> DelayError {
        |error| DelayError::In { log: self.name.clone(), error: Box::new(error) }
    }

    fn detrended<'a>(&self, logged: &'a Experiment<'_>) -> Result<Experiment<'a>> {
        Ok(logged.detrended(self.detrend).map_err(self.in_log())?)
    }

    /// The channels as logged, so that messages show the values in the file; the window and the bias.
    fn prepared(&self) -> Result<(Experiment<'_>, Search, Bias)> {
        for channels in [&self.inputs, &self.outputs] {
            if let Some((_, twice)) =
                channels.iter().enumerate().find(|(i, c)| channels[..*i].contains(c))
            {
                return Err(DelayError::Twice { channel: twice.clone() }.into());
            }
        }
        let (ts, recordings) = recordings(&self.logs, &self.inputs, &self.outputs)?;
        let logged = Experiment::new(ts, self.inputs.clone(), self.outputs.clone(), recordings)
            .map_err(self.in_log())?;
        let mut search =
            Search { max_delay: self.max_delay(ts)?, stop: self.stop.clone(), ..Search::default() };
        let mut bias = Bias::Assumed;
        if let Some(model) = &self.model {
            search.bias = self.relative_degrees(model, ts)?;
            bias = Bias::Model(model.name.clone());
        }
        if let Some(given) = self.degree_bias {
            (search.bias, search.default_bias) = (Vec::new(), given);
            bias = Bias::Given(given);
        }
        Ok((logged, search, bias))
    }

    fn max_delay(&self, ts: SampleTime) -> Result<usize> {
        let samples = self.logs.iter().map(Log::len).max().unwrap_or(0);
        // No method could search more in a short record.
        let Some(seconds) = self.max_delay_s else {
            return Ok(Search::default().max_delay.min(samples / 4).max(1));
        };
        let longest = whole(ts, seconds)?;
        if longest == 0 || longest >= samples {
            return Err(DelayError::MaxDelay { seconds, step_s: ts.seconds(), samples }.into());
        }
        Ok(longest)
    }

    /// Every pair by every pair method, and the longest delay searched in any, samples.
    fn pairs(
        &self,
        logged: &Experiment<'_>,
        experiment: &Experiment<'_>,
        search: &Search,
    ) -> Result<(Vec<Pair>, usize)> {
        let methods: Vec<&Ready> =
            self.methods.iter().filter(|r| r.method.scope == Scope::Pair).collect();
        let (mut pairs, mut longest) = (Vec::new(), search.max_delay);
        if methods.is_empty() {
            return Ok((pairs, longest));
        }
        for o in 0..self.outputs.len() {
            let shares = Shares::of(&experiment.towards(0, o)?, search.max_delay, &self.stop)?;
            for i in 0..self.inputs.len() {
                self.stop.check()?;
                let of = Of { logged, experiment, search, methods: &methods, names: [i, o] };
                let (pair, searched) = self.in_its_window(&of, shares.as_ref())?;
                pairs.push(pair);
                longest = longest.max(searched);
            }
        }
        Ok((pairs, longest))
    }

    /// One pair, and the window in which its response begins. Without a given window it grows while the estimate of a trusted method is at its end.
    fn in_its_window(&self, of: &Of<'_, '_>, shares: Option<&Shares>) -> Result<(Pair, usize)> {
        let [i, o] = of.names;
        let every = (self.inputs.len() * self.outputs.len()) as f64;
        let at = |done: usize| (o * self.inputs.len() + i + done) as f64 / every;
        let far = self.far.part(at(0), at(1));
        let [input, output] = [&self.inputs[i], &self.outputs[o]];
        far.at(0.0, &format_args!("what the record of {input} and {output} shows"));
        let given = self.max_delay_s.is_some();
        let most = if given { of.search.max_delay } else { most(of.experiment.longest()) };
        let mut window = of.search.max_delay;
        let one = of.experiment.select(i, o)?;
        if let Some(poor) = self.too_poor(&one, of.methods, window, of.names)? {
            return Ok((poor, window));
        }
        if !given {
            window = reaching(&one.pair(0, 0)?, window, &self.stop)?.min(most);
        }
        let mut two_sensors = false;
        loop {
            let mut search = Search { max_delay: window, ..of.search.clone() };
            if two_sensors {
                search.default_bias = 0;
            }
            let wider = (window != of.search.max_delay)
                .then(|| Shares::of(&of.experiment.towards(0, o)?, window, &self.stop))
                .transpose()?
                .flatten();
            let shares = if window == of.search.max_delay { shares } else { wider.as_ref() };
            let mut seen = self.seen(of.logged, of.experiment, &search, (i, o), shares)?;
            if two_sensors {
                // A fraction of a sample begins before its command, as a loop does.
                seen.looped = InLoop::default();
            }
            if window == of.search.max_delay && window < most && !seen.looped.closed() {
                let at_rest = seen.by_start(Start::Rest).pair(0, 0)?;
                window = reaching_by_model(&at_rest, window, most);
                if window > search.max_delay {
                    continue;
                }
            }
            let one = OnePair {
                job: self,
                methods: of.methods,
                seen,
                shares,
                names: of.names,
                grows: window < most,
                two_sensors,
                far: far.clone(),
            };
            match one.estimated()? {
                Estimated::Pair(pair) => return Ok((*pair, window)),
                Estimated::Wider => window = (2 * window).min(most),
                Estimated::TwoSensors => two_sensors = true,
            }
        }
    }

    /// Applies `of` to the view of every pair, outputs first.
    fn each_pair<'a, T>(
        &self,
        logged: &'a Experiment<'_>,
        experiment: &'a Experiment<'_>,
        search: &Search,
        of: impl Fn(&dyn Fn() -> Result<PairView<'a>>, Option<&Shares>, [usize; 2]) -> Result<T>,
    ) -> Result<Vec<T>> {
        let mut all = Vec::new();
        for o in 0..self.outputs.len() {
            let shares = Shares::of(&experiment.towards(0, o)?, search.max_delay, &self.stop)?;
            for i in 0..self.inputs.len() {
                self.stop.check()?;
                let seen = || self.seen(logged, experiment, search, (i, o), shares.as_ref());
                all.push(of(&seen, shares.as_ref(), [i, o])?);
            }
        }
        Ok(all)
    }
}

/// One pair of an estimation.
struct Of<'a, 'b> {
    logged: &'a Experiment<'b>,
    experiment: &'a Experiment<'b>,
    search: &'a Search,
    /// The pair methods.
    methods: &'a [&'a Ready],
    /// The indices of the input and the output.
    names: [usize; 2],
}

/// The predicted accuracy of each method for one pair.
#[derive(Debug, Clone, PartialEq)]
pub struct Expected {
    /// The input.
    pub input: String,
    /// The output.
    pub output: String,
    /// Methods by name; `None` without a prediction.
    pub methods: Vec<(&'static str, Option<Richness>)>,
}

#[cfg(test)]
mod tests {
    use super::super::chosen::chosen;
    use super::*;
    use crate::error::Error;
    use deadtime_log::Channel;
    use deadtime_signal::Excitation;
    use deadtime_signal::excitation::Rbs;
    use deadtime_signal::stop::Stop;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use std::collections::BTreeMap;

    fn experiment(samples: usize) -> Experiment<'static> {
        let u = Rbs::default().generate(samples, &mut ChaCha8Rng::seed_from_u64(1)).unwrap();
        let noise = Rbs::default().generate(samples, &mut ChaCha8Rng::seed_from_u64(2)).unwrap();
        let mut y = vec![0.0; samples];
        for t in 6..samples {
            y[t] = 1.5 * y[t - 1] - 0.56 * y[t - 2] + 0.1 * u[t - 6] + 0.05 * noise[t];
        }
        Experiment::siso(SampleTime::new(0.1).unwrap(), u, y).unwrap()
    }

    fn job(stop: Stop) -> Job {
        let experiment = experiment(400);
        let recording = &experiment.recordings()[0];
        let time_s = (0..400).map(|k| 0.1 * f64::from(k)).collect();
        let channels = vec![
            Channel::new("u", None, recording.inputs[0].to_vec()),
            Channel::new("y", None, recording.outputs[0].values.to_vec()),
        ];
        let logs = vec![Log::new("log", time_s, channels).unwrap()];
        let methods = chosen(&["arxstruc".to_owned()], &BTreeMap::new(), &[Scope::Pair]).unwrap();
        Job { methods, stop, ..Job::new(logs, ["u"], ["y"]) }
    }

    #[test]
    fn a_job_that_is_no_longer_wanted_has_no_report() {
        assert_eq!(job(Stop::default()).run().unwrap().pairs.len(), 1);
        let stop = Stop::default();
        stop.set();
        assert!(matches!(job(stop.clone()).run(), Err(Error::Stopped(_))));
        assert!(matches!(job(stop).expected(), Err(Error::Stopped(_))));
    }

    #[test]
    fn a_method_that_is_stopped_in_the_middle_does_not_answer() {
        let experiment = experiment(60_000);
        for name in
            ["p3d", "p1dz", "ivstruc", "armaxstruc", "oestruc", "oe_posterior", "sampling_zero"]
        {
            let ready =
                chosen(&[name.to_owned()], &BTreeMap::new(), &[Scope::Pair]).unwrap().remove(0);
            for wait in [0, 20, 60] {
                let search = Search::default();
                let wish = search.stop.clone();
                let waiter = std::thread::spawn(move || {
                    std::thread::sleep(std::time::Duration::from_millis(wait));
                    wish.set();
                });
                match ready.estimator.estimate(&experiment, &search) {
                    Err(DelayError::Stopped) => {}
                    // The method finished before the cancellation.
                    Ok(answer) => assert!(wait > 0 && answer.delay_s.is_some(), "{name}"),
                    Err(other) => panic!("{name}: {other}"),
                }
                waiter.join().unwrap();
            }
        }
    }
}
