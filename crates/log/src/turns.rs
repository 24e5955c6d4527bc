//! Angles without their whole turns, quaternions of one sign: what jumps in a log and not in the machine.
//!
//! How it can be wrong: a rotation by more than half a turn between two measured samples is read as the shorter way.

use std::collections::VecDeque;

use super::channels::{Channel, Log, Output};
use super::error::LogError;

/// Jumps that miss a whole turn by less than this share of it are taken for one.
const NEARLY: f64 = 0.1;
/// All other steps must be below this share of a whole turn.
const SMALL: f64 = 0.25;
/// The number of steps before a jump whose sum must have the opposite sign, at half of the jumps or more. A command that steps by a whole turn is constant before.
const BEFORE: usize = 5;

impl Log {
    /// The log with the whole turns of an angle removed: each sample is within half a turn of the one measured before it.
    ///
    /// `turn` is a whole turn in the channel's unit.
    ///
    /// # Errors
    /// As [`Log::channel`].
    pub fn without_turns(self, name: &str, turn: f64) -> Result<Self, LogError> {
        let angle = self.channel(name)?.samples();
        let (mut turns, mut before) = (0.0, None::<f64>);
        let mut continuous = |k: usize| {
            let Some(own) = angle.get(k) else { return 0.0 };
            turns -= before.map_or(0.0, |b| ((own - b) / turn).round());
            before = Some(own);
            own + turns * turn
        };
        let values = (0..self.len()).map(&mut continuous).collect();
        self.with_values(&[(name, values)])
    }

    /// The log with a quaternion (scalar last) that does not jump to its negative, which is the same rotation. It begins with a scalar that is not negative.
    ///
    /// # Errors
    /// As [`Log::channel`].
    pub fn of_one_sign(self, names: [&str; 4]) -> Result<Self, LogError> {
        let [x, y, z, w] = names.map(|name| self.channel(name).map(Channel::samples));
        let parts = [x?, y?, z?, w?];
        // The first is compared with no rotation: its scalar alone counts.
        let (mut sign, mut before) = (1.0, [0.0, 0.0, 0.0, 1.0]);
        let mut signs = Vec::with_capacity(self.len());
        for k in 0..self.len() {
            if let [Some(x), Some(y), Some(z), Some(w)] = parts.map(|p| p.get(k)) {
                let own = [x, y, z, w];
                let along: f64 = own.iter().zip(before).map(|(a, b)| a * b).sum();
                sign = if along < 0.0 { -1.0 } else { 1.0 };
                before = own.map(|v| v * sign);
            }
            signs.push(sign);
        }
        let turned = |part: &Output<'_>| {
            part.values.iter().zip(&signs).map(|(v, s)| v * s).collect::<Vec<f64>>()
        };
        let values: Vec<_> = names.into_iter().zip(parts.iter().map(turned)).collect();
        self.with_values(&values)
    }

    /// The number of jumps of a channel by a whole turn, where it moves little otherwise: an angle that is logged within one turn.
    #[must_use]
    pub fn whole_turns(&self, name: &str, turn: f64) -> usize {
        let Ok(channel) = self.channel(name) else { return 0 };
        let angle = channel.samples();
        let there: Vec<f64> = (0..self.len()).filter_map(|k| angle.get(k)).collect();
        let (mut jumps, mut led, mut before) = (0, 0, VecDeque::from([0.0; BEFORE]));
        for step in super::place::neighbours(&there).map(|(a, b)| (b - a) / turn) {
            if step.abs() > 1.0 - NEARLY {
                jumps += 1;
                led += usize::from(before.iter().sum::<f64>() * step < 0.0);
            } else {
                before.pop_front();
                before.push_back(step);
            }
            if step.abs() >= 1.0 + NEARLY || (SMALL..=1.0 - NEARLY).contains(&step.abs()) {
                return 0;
            }
        }
        if 2 * led >= jumps { jumps } else { 0 }
    }

    /// The log with other values of some channels, one per time stamp.
    fn with_values(mut self, values: &[(&str, Vec<f64>)]) -> Result<Self, LogError> {
        for (name, values) in values {
            self.channel(name)?;
            for channel in self.channels.iter_mut().filter(|c| c.name == *name) {
                channel.values = values.clone().into();
            }
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    fn log(columns: &[(&str, Vec<f64>)]) -> Log {
        let time = (0..columns[0].1.len()).map(|k| k as f64).collect();
        Log::new(
            "log",
            time,
            columns
                .iter()
                .map(|(name, values)| Channel::new(*name, None, values.clone()))
                .collect(),
        )
        .unwrap()
    }

    #[test]
    fn a_heading_that_is_logged_within_one_turn_goes_on() {
        let truth: Vec<f64> = (0..200).map(|k| 3.0 + 9.0 * (f64::from(k) / 20.0).sin()).collect();
        let logged: Vec<f64> = truth.iter().map(|v| (v + PI).rem_euclid(TAU) - PI).collect();
        let log = log(&[("yaw", logged), ("rate", truth.clone())]);
        assert!(log.whole_turns("yaw", TAU) > 3 && log.whole_turns("rate", TAU) == 0);
        let mended = log.without_turns("yaw", TAU).unwrap();
        let found = mended.input("yaw").unwrap();
        assert!(found.iter().zip(&truth).all(|(a, b)| (a - b).abs() < 1e-12));
        assert_eq!(mended.input("rate").unwrap(), truth);
        // Missing samples stay missing; behind them the turn goes on.
        let mut gap = mended
            .input("yaw")
            .unwrap()
            .iter()
            .map(|v| Some((v + PI).rem_euclid(TAU) - PI))
            .collect::<Vec<_>>();
        gap[50..53].fill(None);
        let log = Log::new(
            "log",
            (0..200).map(f64::from).collect(),
            vec![Channel::partial(
                "yaw",
                None,
                gap.iter().map(|v| v.unwrap_or(0.0)).collect(),
                gap.iter().map(Option::is_some).collect(),
            )],
        )
        .unwrap();
        let mended = log.without_turns("yaw", TAU).unwrap();
        let found = mended.output("yaw").unwrap();
        assert!(
            (0..200).all(|k| found
                .get(k)
                .map_or((50..53).contains(&k), |v| (v - truth[k]).abs() < 1e-12))
        );
    }

    #[test]
    fn what_jumps_by_other_sizes_does_not_wrap() {
        let square: Vec<f64> = (0..100).map(|k| if k / 10 % 2 == 0 { 0.0 } else { 7.5 }).collect();
        // A joint that is commanded a whole turn on and back.
        let command: Vec<f64> = (0..100).map(|k| if k / 10 % 2 == 0 { 0.0 } else { TAU }).collect();
        let fast: Vec<f64> = (0..100).map(|k| f64::from(k * k % 17)).collect();
        let log = log(&[("square", square), ("command", command), ("fast", fast)]);
        assert!(
            ["square", "command", "fast", "none"]
                .iter()
                .all(|name| log.whole_turns(name, TAU) == 0)
        );
    }

    #[test]
    fn a_quaternion_that_turns_twice_round_keeps_its_sign() {
        let half = |k: usize| 0.05 * k as f64;
        let truth: Vec<[f64; 4]> =
            (0..200).map(|k| [0.0, half(k).sin(), 0.0, half(k).cos()]).collect();
        // Logged with a scalar that is never negative.
        let logged: Vec<[f64; 4]> =
            truth.iter().map(|q| q.map(|v| if q[3] < 0.0 { -v } else { v })).collect();
        let part = |of: &[[f64; 4]], i: usize| of.iter().map(|q| q[i]).collect::<Vec<f64>>();
        let log = log(&[
            ("x", part(&logged, 0)),
            ("y", part(&logged, 1)),
            ("z", part(&logged, 2)),
            ("w", part(&logged, 3)),
        ]);
        let mended = log.of_one_sign(["x", "y", "z", "w"]).unwrap();
        for (i, name) in ["x", "y", "z", "w"].into_iter().enumerate() {
            assert!(
                mended
                    .input(name)
                    .unwrap()
                    .iter()
                    .zip(part(&truth, i))
                    .all(|(a, b)| (a - b).abs() < 1e-15),
                "{name}"
            );
        }
    }
}
