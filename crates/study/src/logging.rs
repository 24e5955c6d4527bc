//! How a record reaches the log: samples that are missing, and stamps off the grid.
//!
//! A program that commands and measures at once does so at t(k), off k·Ts by a share of the sample time. The plant holds u(k) from t(k) to t(k + 1). The log is
//! resampled to the even grid as by the command line, inputs held and outputs interpolated. Every result that needs a missing sample is missing too.

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use super::error::Result;
use deadtime_delay::Series;
use deadtime_log::{Channel, Log};
use deadtime_signal::time::SampleTime;

/// Steps of a sample: stamps are multiples of one.
pub(super) const STEPS: usize = 50;
/// Stamps further off could change places.
const MOST_JITTER: f64 = 0.45;
/// A log with fewer samples gives no estimate.
const MOST_MISSING: f64 = 0.9;

/// The defects of a log; none by default.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Logging {
    /// Chance of each sample of an output to be missing; of each event, at either place, to be missed.
    pub missing: f64,
    /// Largest share of the sample time by which a stamp is off the grid, up or down with equal probabilities. The command of that stamp takes effect then.
    pub jitter: f64,
}

impl Logging {
    /// Shares that can be.
    pub(super) fn check(&self) -> Result<(), String> {
        let Self { missing, jitter } = *self;
        if !(0.0..=MOST_MISSING).contains(&missing) {
            return Err(format!("missing is {missing}: give a share from 0 to {MOST_MISSING}"));
        }
        if !(0.0..=MOST_JITTER).contains(&jitter) {
            return Err(format!(
                "jitter is {jitter}: give a share of the sample time from 0 to {MOST_JITTER}"
            ));
        }
        Ok(())
    }

    /// Every sample is there, at its time.
    pub(super) fn is_plain(&self) -> bool {
        *self == Self::default()
    }

    /// Which of these are there.
    pub(super) fn present(&self, samples: usize, rng: &mut impl Rng) -> Vec<bool> {
        (0..samples).map(|_| !rng.random_bool(self.missing)).collect()
    }

    /// Stamps in steps, the first at 0, each later than the one before; `None` without jitter.
    pub(super) fn stamps(&self, samples: usize, rng: &mut impl Rng) -> Option<Vec<usize>> {
        let reach = (self.jitter * STEPS as f64).round() as usize;
        (reach > 0).then(|| {
            let drawn: Vec<usize> =
                (0..samples).map(|k| STEPS * k + rng.random_range(0..=2 * reach)).collect();
            let from = drawn.first().copied().unwrap_or(0);
            drawn.into_iter().map(|stamp| stamp - from.min(stamp)).collect()
        })
    }

    /// The log of a record: inputs, and outputs with their missing samples.
    pub(super) fn read(
        &self,
        names: (&[String], &[String]),
        (inputs, outputs): (&[Vec<f64>], &[Vec<f64>]),
        stamps: Option<&[usize]>,
        sample_time: SampleTime,
        rng: &mut impl Rng,
    ) -> Result<(Vec<Vec<f64>>, Vec<Series<'static>>)> {
        let missing = self.missing > 0.0;
        let present: Vec<Option<Vec<bool>>> =
            outputs.iter().map(|y| missing.then(|| self.present(y.len(), rng))).collect();
        let Some(stamps) = stamps else {
            let series = |(y, present): (&Vec<f64>, Option<Vec<bool>>)| Series {
                values: y.clone().into(),
                present: present.map(Into::into),
            };
            return Ok((inputs.to_vec(), outputs.iter().zip(present).map(series).collect()));
        };
        let time_s =
            stamps.iter().map(|t| sample_time.to_seconds(*t as f64 / STEPS as f64)).collect();
        let commands = names
            .0
            .iter()
            .zip(inputs)
            .map(|(name, u)| Channel::new(name.as_str(), None, u.clone()));
        let responses =
            names.1.iter().zip(outputs).zip(present).map(|((name, y), present)| match present {
                Some(present) => Channel::partial(name.as_str(), None, y.clone(), present),
                None => Channel::new(name.as_str(), None, y.clone()),
            });
        let held: Vec<&str> = names.0.iter().map(String::as_str).collect();
        let even = Log::new("record", time_s, commands.chain(responses).collect())?
            .resample(sample_time, &held)?;
        let inputs =
            names.0.iter().map(|name| Ok(even.input(name)?.to_vec())).collect::<Result<_>>()?;
        let output = |name: &String| -> Result<Series<'static>> {
            let measured = even.output(name)?;
            Ok(Series {
                values: measured.values.to_vec().into(),
                present: measured.present.map(|p| p.to_vec().into()),
            })
        };
        Ok((inputs, names.1.iter().map(output).collect::<Result<_>>()?))
    }
}

/// A value that is held from each stamp to the next, by steps, one sample longer than the stamps.
pub(super) fn held(values: &[f64], stamps: &[usize]) -> Vec<f64> {
    let ends = stamps.iter().skip(1).copied().chain(stamps.last().map(|last| last + STEPS));
    values
        .iter()
        .zip(stamps.iter().zip(ends))
        .flat_map(|(v, (from, to))| std::iter::repeat_n(*v, to.saturating_sub(*from)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    #[test]
    fn stamps_increase_and_stay_within_their_share_of_a_sample() {
        let logging = Logging { jitter: MOST_JITTER, missing: 0.0 };
        let stamps = logging.stamps(2000, &mut ChaCha8Rng::seed_from_u64(1)).unwrap();
        assert_eq!(stamps[0], 0);
        assert!(stamps.windows(2).all(|w| w[1] > w[0]));
        let off: Vec<f64> =
            stamps.iter().enumerate().map(|(k, t)| *t as f64 / STEPS as f64 - k as f64).collect();
        let [least, most] =
            [off.iter().copied().fold(0.0, f64::min), off.iter().copied().fold(0.0, f64::max)];
        // Reach 23 of 50 steps up and down: nearly all of 0.92 samples is used.
        assert!(most - least > 0.9 && most - least <= 0.92 + 1e-12, "{least} {most}");
        assert_eq!(Logging::default().stamps(10, &mut ChaCha8Rng::seed_from_u64(1)), None);
    }

    #[test]
    fn what_is_missing_of_a_log_with_uneven_stamps_takes_with_it_what_is_made_of_it() {
        let (names, ts) =
            ((vec!["u".to_owned()], vec!["y".to_owned()]), SampleTime::new(0.5).unwrap());
        let logging = Logging { missing: 0.1, jitter: 0.2 };
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let stamps = logging.stamps(1000, &mut rng).unwrap();
        // y(t) = t, so that every interpolated sample is its time.
        let y: Vec<f64> = stamps.iter().map(|t| 0.5 * *t as f64 / STEPS as f64).collect();
        let u: Vec<f64> = (0..1000).map(f64::from).collect();
        let (u, y) =
            logging.read((&names.0, &names.1), (&[u], &[y]), Some(&stamps), ts, &mut rng).unwrap();
        let present = y[0].present.as_deref().unwrap();
        let there = present.iter().filter(|p| **p).count() as f64 / present.len() as f64;
        // Two neighbours are needed off the stamps: 0.9² of them are there.
        assert!(there > 0.76 && there < 0.87, "{there}");
        for (k, v) in y[0].values.iter().enumerate().filter(|(k, _)| present[*k]) {
            assert!((v - 0.5 * k as f64).abs() < 1e-9);
        }
        // The command in force at k·Ts is that of the last stamp.
        for (k, v) in u[0].iter().enumerate() {
            let last = stamps.iter().filter(|t| **t <= k * STEPS).count() - 1;
            assert_eq!(*v, last as f64);
        }
    }

    #[test]
    fn a_held_value_lasts_from_its_stamp_to_the_next() {
        let values = held(&[1.0, 2.0, 3.0], &[0, 40, 110]);
        assert_eq!(values.len(), 160);
        assert!(
            values[..40].iter().all(|v| *v == 1.0)
                && values[40..110].iter().all(|v| *v == 2.0)
                && values[110..].iter().all(|v| *v == 3.0)
        );
    }
}
