//! `deadtime excite`: makes an excitation signal and writes it as a log.

use std::io::Write;
use std::path::PathBuf;

use anyhow::bail;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde_json::Value;

use super::show::Out;
use deadtime_signal::excitation::by_name;
use deadtime_signal::file::write_atomic;
use deadtime_signal::registry::options;
use deadtime_signal::time::SampleTime;

/// Make an excitation signal (ramps, impulse, step, RBS, PRBS, multisine, chirp, doublet, 3-2-1-1) as a CSV log
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime excite prbs --samples 1000 --sample-time 0.01 --out u.csv
  deadtime excite rbs --samples 400 --sample-time 0.05 --set band=[0,0.5] --channel rudder --out u.csv")]
pub(crate) struct Excite {
    /// Name of the signal; `deadtime list excitations` shows all, with their options
    name: String,
    /// Number of samples
    #[arg(long, value_name = "N")]
    samples: usize,
    /// Sample time in seconds
    #[arg(long, value_name = "S")]
    sample_time: f64,
    /// Seed of the random signals: the same seed makes the same signal
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// An option of the signal, such as `amplitude=0.01` or `band=[0,0.3]`; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Name of the signal's column
    #[arg(long, value_name = "NAME", default_value = "u")]
    channel: String,
    /// File to write; without it the log goes to standard output
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
}

impl Excite {
    /// Makes the signal and writes it.
    pub(crate) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let entry = by_name(&self.name)?;
        let sample_time = SampleTime::new(self.sample_time)?;
        if self.channel.trim().is_empty() || self.channel == "time" {
            bail!("channel `{}`: give the signal's column a name other than `time`", self.channel);
        }
        let given = options(self.set.iter().map(String::as_str))?;
        let signal = entry.with(given.clone())?;
        let u = signal.generate(self.samples, &mut ChaCha8Rng::seed_from_u64(self.seed))?;
        to.json(&serde_json::json!({
            "signal": entry.name, "channel": self.channel, "samples": u.len(), "sample_time_s": self.sample_time, "seed": self.seed,
            "options": given, "out": self.out
        }))?;
        let Some(path) = &self.out else {
            let mut text = Vec::new();
            write_csv(&mut text, &self.channel, sample_time, &u)?;
            return to.document(&text);
        };
        write_atomic(path, |file| write_csv(file, &self.channel, sample_time, &u))?;
        say!(
            to,
            "{}: {} samples, one every {} s, {} s in all, seed {}, options {}; written to {} as channel {}",
            entry.name,
            u.len(),
            self.sample_time,
            // For people: 151 samples of 0.1 s are 15.1 s, not 15.100000000000001.
            (sample_time.to_seconds(u.len() as f64) * 1e9).round() / 1e9,
            self.seed,
            in_force((entry.defaults)(), given),
            path.display(),
            self.channel,
        );
        Ok(())
    }
}

/// The defaults, overridden by the given options.
fn in_force(mut defaults: Value, given: Value) -> Value {
    if let (Value::Object(all), Value::Object(given)) = (&mut defaults, given) {
        all.extend(given);
    }
    defaults
}

/// Header `time,<channel>`, then a row a sample; every number is the shortest that reads back to the same value.
fn write_csv(
    out: &mut dyn Write,
    channel: &str,
    sample_time: SampleTime,
    u: &[f64],
) -> std::io::Result<()> {
    let mut csv = csv::Writer::from_writer(out);
    // The csv crate's own conversion hides what kind of error it was, a closed pipe too.
    let plain = |e: csv::Error| match e.into_kind() {
        csv::ErrorKind::Io(e) => e,
        other => std::io::Error::other(format!("{other:?}")),
    };
    csv.write_record(["time", channel]).map_err(plain)?;
    for (k, v) in u.iter().enumerate() {
        csv.write_record([sample_time.to_seconds(k as f64).to_string(), v.to_string()])
            .map_err(plain)?;
    }
    csv.flush()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::show::Color;
    use clap::Parser;

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        excite: Excite,
    }

    fn run(arguments: &str, out: &std::path::Path) -> anyhow::Result<String> {
        let mut words = vec!["deadtime"];
        words.extend(arguments.split_whitespace());
        let mut excite = Line::try_parse_from(words)?.excite;
        excite.out = Some(out.to_owned());
        excite.run(&Out::new(None, true, Color::Never, false))?;
        Ok(std::fs::read_to_string(out)?)
    }

    #[test]
    fn file_holds_time_and_signal() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("u.csv");
        let text = run(
            "step --samples 4 --sample-time 0.1 --set at=2 --set amplitude=0.25 --channel delta",
            &path,
        )
        .unwrap();
        assert_eq!(text, "time,delta\n0,0\n0.1,0\n0.2,0.25\n0.30000000000000004,0.25\n");
    }

    #[test]
    fn numbers_read_back_to_the_bit_and_the_seed_decides() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("u.csv");
        let call = "multisine --samples 151 --sample-time 0.037 --set phase=random --seed";
        let seven = run(&format!("{call} 7"), &path).unwrap();
        let options = serde_json::json!({ "phase": "random" });
        let u = by_name("multisine")
            .unwrap()
            .with(options)
            .unwrap()
            .generate(151, &mut ChaCha8Rng::seed_from_u64(7))
            .unwrap();
        for (k, (row, v)) in seven.lines().skip(1).zip(&u).enumerate() {
            let (time, value) = row.split_once(',').unwrap();
            assert_eq!(time.parse::<f64>().unwrap(), k as f64 * 0.037);
            assert_eq!(value.parse::<f64>().unwrap().to_bits(), v.to_bits());
        }
        assert_eq!(seven, run(&format!("{call} 7"), &path).unwrap());
        assert_ne!(seven, run(&format!("{call} 8"), &path).unwrap());
    }

    #[test]
    fn bad_requests_leave_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("u.csv");
        for (call, says) in [
            ("prsb --samples 10 --sample-time 0.1", "prbs"),
            ("rbs --samples 0 --sample-time 0.1", "at least 1"),
            ("rbs --samples 10 --sample-time 0", "sample time 0"),
            ("rbs --samples 10 --sample-time 0.1 --set bnd=[0,0.5]", "bnd"),
            ("rbs --samples 10 --sample-time 0.1 --set band", "KEY=VALUE"),
            ("rbs --samples 10 --sample-time 0.1 --set band=[0.5,0.1]", "band"),
            ("rbs --samples 10 --sample-time 0.1 --channel time", "channel"),
        ] {
            let refused = run(call, &path).unwrap_err();
            assert!(format!("{refused:#}").contains(says), "{call}: {refused:#}");
            assert!(!path.exists());
        }
    }

    #[test]
    fn options_in_force_are_the_defaults_and_what_was_given() {
        let all = in_force(
            serde_json::json!({ "amplitude": 1.0, "at": 10 }),
            serde_json::json!({ "at": 3 }),
        );
        assert_eq!(all, serde_json::json!({ "amplitude": 1.0, "at": 3 }));
    }
}
