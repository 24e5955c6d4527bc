//! The experiment that would separate what this data cannot, as numbers.

use std::fmt;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::class::{in_words, listed};
use deadtime_signal::stats;

/// Effects that a sentence names; the others are counted.
const LISTED: usize = 3;

/// Samples of an experiment at most.
pub(crate) const SAMPLES: usize = 3000;

/// A proposed experiment. Its `Display` is the text of `next_experiment` in a diagnosis.
#[derive(Debug, Clone, PartialEq)]
pub struct NextExperiment {
    /// The separated hypotheses: `effect:channel` of each, or the states whose initial values decide.
    pub separates: Vec<String>,
    /// The proposed record.
    pub proposal: Proposal,
}

/// The proposed record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Proposal {
    /// Commands under which the first two hypotheses were simulated.
    Commands {
        /// The commands.
        signal: Signal,
        /// Expected log Bayes factor of the first two.
        log_bayes_factor: f64,
        /// Duration, s.
        duration_s: f64,
    },
    /// No simulated experiment separates them.
    NothingSeparates,
    /// By the kinds of the effects, where nothing can be simulated ahead.
    Advice(Advice),
    /// A known initial state.
    KnownStart,
}

/// Commands, from the logged ones. Amplitudes are in standard deviations of each logged command, about its mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Signal {
    /// The logged commands again.
    Logged {
        /// Factor of their deviation from the mean; 0: commands held.
        scale: f64,
        /// Shift of the mean.
        shift: f64,
    },
    /// Reversals at random, one chance per sample.
    RandomReversals {
        /// Amplitude.
        amplitude: f64,
    },
    /// A triangle wave.
    Triangle {
        /// Amplitude.
        amplitude: f64,
        /// Periods of the whole experiment.
        periods: usize,
    },
    /// A square wave.
    Square {
        /// Amplitude.
        amplitude: f64,
        /// Periods of the whole experiment.
        periods: usize,
    },
    /// Commands held, the state released from a displaced start.
    Release,
}

/// Advice by the kinds of the effects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Advice {
    /// Several amplitudes.
    Amplitudes,
    /// Another operating point.
    OperatingPoint,
    /// A broadband excitation.
    Bandwidth,
    /// Motion without commands.
    OtherMotion,
    /// A multisine.
    Multisine,
}

impl Signal {
    /// The signals that are simulated, in the order in which equals lead.
    pub(crate) const TRIED: [Self; 8] = [
        Self::Logged { scale: 2.0, shift: 0.0 },
        Self::Logged { scale: 1.0 / 3.0, shift: 0.0 },
        Self::Logged { scale: 1.0, shift: 2.0 },
        Self::RandomReversals { amplitude: 1.0 },
        Self::Triangle { amplitude: 2.0, periods: 4 },
        Self::Square { amplitude: 1.5, periods: 4 },
        Self::Logged { scale: 0.0, shift: 0.0 },
        Self::Release,
    ];

    /// The commands, one list of `count` samples per input; `std` are the inputs' standard deviations.
    pub(crate) fn commands(self, inputs: &[Vec<f64>], std: &[f64], count: usize) -> Vec<Vec<f64>> {
        let mean: Vec<f64> =
            inputs.iter().map(|u| u.iter().sum::<f64>() / u.len().max(1) as f64).collect();
        let each = |value: &mut dyn FnMut(usize, usize) -> f64| -> Vec<Vec<f64>> {
            (0..inputs.len()).map(|j| (0..count).map(|k| value(j, k)).collect()).collect()
        };
        let phase = |periods: usize, k: usize| (periods * k) as f64 / count as f64 % 1.0;
        match self {
            Self::Logged { scale, shift } => {
                each(&mut |j, k| mean[j] + scale * (inputs[j][k] - mean[j]) + shift * std[j])
            }
            Self::Release => Self::Logged { scale: 0.0, shift: 0.0 }.commands(inputs, std, count),
            Self::RandomReversals { amplitude } => {
                let mut rng = ChaCha8Rng::seed_from_u64(1);
                each(&mut |j, _| {
                    mean[j] + if rng.random::<bool>() { amplitude } else { -amplitude } * std[j]
                })
            }
            Self::Triangle { amplitude, periods } => each(&mut |j, k| {
                mean[j] + amplitude * std[j] * (1.0 - 4.0 * (phase(periods, k) - 0.5).abs())
            }),
            Self::Square { amplitude, periods } => each(&mut |j, k| {
                mean[j] + if phase(periods, k) < 0.5 { amplitude } else { -amplitude } * std[j]
            }),
        }
    }
}

impl NextExperiment {
    /// The commands that are proposed, as long as the logged ones (one list per input, equally long). `None` where no signal is proposed.
    #[must_use]
    pub fn commands(&self, logged: &[Vec<f64>]) -> Option<Vec<Vec<f64>>> {
        let Proposal::Commands { signal, .. } = self.proposal else { return None };
        let count = logged.iter().map(Vec::len).min()?.min(SAMPLES);
        let std: Vec<f64> = logged.iter().map(|u| stats::deviation(u).unwrap_or(0.0)).collect();
        Some(signal.commands(logged, &std, count))
    }
}

impl fmt::Display for NextExperiment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let worded = |code: &String| match code.split_once(':') {
            Some((effect, channel)) => in_words(effect, channel),
            None => code.clone(),
        };
        let few = self.separates.iter().take(LISTED).map(worded);
        let more = self.separates.len().saturating_sub(LISTED);
        let names = few.chain((more > 0).then(|| format!("{more} more"))).collect::<Vec<_>>();
        let names = listed(&names);
        match self.proposal {
            Proposal::Commands { signal, duration_s, .. } => {
                write!(f, "to separate {names}, {signal}, for {duration_s:.1} s.")
            }
            Proposal::NothingSeparates => write!(
                f,
                "log a signal between command and response; no experiment with the logged signals separates {names}."
            ),
            Proposal::Advice(advice) => write!(f, "to separate {names}, {advice}."),
            Proposal::KnownStart => {
                let states: Vec<String> = self.separates.iter().map(|s| format!("`{s}`")).collect();
                write!(
                    f,
                    "begin from a known state and give it as initial_std, or step the operating point; the verdict depends on the start of {}.",
                    states.join(", ")
                )
            }
        }
    }
}

impl fmt::Display for Signal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match *self {
            Self::Logged { scale: 0.0, .. } => "record at rest, commands held",
            Self::Logged { shift, .. } if shift != 0.0 => {
                "repeat the commands about another operating point"
            }
            Self::Logged { scale: 2.0, .. } => "repeat the commands at twice the amplitude",
            Self::Logged { scale, .. } if scale == 1.0 / 3.0 => {
                "repeat the commands at a third of the amplitude"
            }
            Self::Logged { scale, .. } => {
                return write!(f, "repeat the commands at {scale} times the amplitude");
            }
            Self::RandomReversals { .. } => {
                "excite with a signal that reverses at random at every sample"
            }
            Self::Triangle { .. } => "move slowly to and fro, with reversals through zero",
            Self::Square { .. } => "command steps and hold them until everything has settled",
            Self::Release => {
                "record motion that is not caused by the commands (a release from a displaced start, an impulse by hand), commands held"
            }
        })
    }
}

impl fmt::Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Amplitudes => {
                "repeat the experiment at two or more amplitudes, with slow reversals through zero"
            }
            Self::OperatingPoint => "step the operating point, and start from a known state",
            Self::Bandwidth => {
                "excite with a broadband signal that reaches well above one over the lag, at two amplitudes"
            }
            Self::OtherMotion => {
                "record motion that is not caused by the commands (a release from a displaced start, an impulse by hand), together with the same commands"
            }
            Self::Multisine => {
                "excite with a multisine over the whole bandwidth, at two amplitudes and two operating points"
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn proposed(signal: Signal) -> NextExperiment {
        NextExperiment {
            separates: vec!["a".into(), "b".into()],
            proposal: Proposal::Commands { signal, log_bayes_factor: 9.0, duration_s: 4.0 },
        }
    }

    #[test]
    fn a_proposed_signal_has_its_commands() {
        let logged = vec![vec![1.0, 3.0, 1.0, 3.0], vec![0.0, 0.0, 1.0, 1.0]];
        let twice = proposed(Signal::Logged { scale: 2.0, shift: 0.0 });
        assert_eq!(
            twice.to_string(),
            "to separate a and b, repeat the commands at twice the amplitude, for 4.0 s."
        );
        assert_eq!(
            twice.commands(&logged),
            Some(vec![vec![0.0, 4.0, 0.0, 4.0], vec![-0.5, -0.5, 1.5, 1.5]])
        );
        assert_eq!(
            proposed(Signal::Release).commands(&logged),
            Some(vec![vec![2.0; 4], vec![0.5; 4]])
        );
        assert_eq!(twice.commands(&[]), None);
        let nothing = NextExperiment { proposal: Proposal::NothingSeparates, ..twice };
        assert_eq!(nothing.commands(&logged), None);
    }

    #[test]
    fn every_tried_signal_has_words_of_its_own() {
        let words: std::collections::BTreeSet<String> =
            Signal::TRIED.iter().map(ToString::to_string).collect();
        assert_eq!(words.len(), Signal::TRIED.len());
    }
}
