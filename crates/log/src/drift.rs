//! Channels without the drift of their record.

use super::channels::Log;
use super::error::LogError;

impl Log {
    /// The log without the slope of the least-squares straight line through each of these channels over time; their means stay.
    ///
    /// How it can be wrong: a slow response is taken for a drift, and a drift that turns is no straight line.
    ///
    /// # Errors
    /// As [`Log::channel`].
    pub fn without_drift(mut self, names: &[String]) -> Result<Self, LogError> {
        let start_s = self.start_s();
        for name in names {
            let samples = self.channel(name)?.samples();
            let there = || {
                let stamps = self.time_s.iter().enumerate();
                stamps.filter_map(|(k, t)| Some((t - start_s, samples.get(k)?)))
            };
            let count = there().count().max(1) as f64;
            let (middle, mean) =
                there().fold((0.0, 0.0), |(t, v), (s, x)| (t + s / count, v + x / count));
            let (spread, moment) = there().fold((0.0, 0.0), |(a, b), (s, x)| {
                (a + (s - middle).powi(2), b + (s - middle) * (x - mean))
            });
            let slope = if spread > 0.0 { moment / spread } else { 0.0 };
            let flat = |(k, (t, v)): (usize, (&f64, &f64))| match samples.get(k) {
                Some(_) => v - slope * (t - start_s - middle),
                None => *v,
            };
            let values: Vec<f64> =
                self.time_s.iter().zip(samples.values).enumerate().map(flat).collect();
            for channel in self.channels.iter_mut().filter(|c| c.name == *name) {
                channel.values = values.clone().into();
            }
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::super::channels::Channel;
    use super::*;

    #[test]
    fn a_slope_goes_and_the_mean_stays_also_on_uneven_stamps() {
        let time: Vec<f64> = (0..60).map(|k| 1e9 + f64::from(k) + 0.3 * f64::from(k % 3)).collect();
        let wave = |k: usize| (0.7 * k as f64).sin();
        let drifting: Vec<f64> =
            time.iter().enumerate().map(|(k, t)| 4.0 + 0.2 * (t - 1e9) + wave(k)).collect();
        let own = |values: Vec<f64>| {
            Log::new("log", time.clone(), vec![Channel::new("y", None, values)]).unwrap()
        };
        let names = ["y".to_owned()];
        let flat = own(drifting.clone()).without_drift(&names).unwrap();
        // The same of the wave alone: a straight line added takes nothing else off.
        let plain = own((0..60).map(wave).collect()).without_drift(&names).unwrap();
        let (flat, plain) = (flat.input("y").unwrap().to_vec(), plain.input("y").unwrap().to_vec());
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        assert!((mean(&flat) - mean(&drifting)).abs() < 1e-9);
        for (a, b) in flat.iter().zip(&plain) {
            assert!((a - mean(&flat) - (b - mean(&plain))).abs() < 1e-9, "{a} {b}");
        }
        assert!(own(plain).without_drift(&["z".to_owned()]).is_err());
    }
}
