//! The dead time between a command and a response: of two arrays by one method, and of a log by all of them.
//!
//! `cargo run --example find_delay`

use std::path::Path;

use deadtime::delay::{DelayEstimator, Experiment, Job, Oestruc, Search};
use deadtime::log;
use deadtime::rand::{RngExt, SeedableRng};
use deadtime::time::SampleTime;
use rand_chacha::ChaCha8Rng;

fn main() -> deadtime::Result<()> {
    // Two arrays on an even grid: a lag that answers a random command four samples late, and one sample of the hold.
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let command: Vec<f64> = (0..400).map(|_| if rng.random() { 1.0 } else { -1.0 }).collect();
    let mut response = vec![0.0; 400];
    for t in 5..400 {
        response[t] = 0.8 * response[t - 1] + command[t - 5] + 0.1 * rng.random_range(-1.0..1.0);
    }

    // Checked once, borrowed from here on. What has no answer is an outcome of the estimate, not an error.
    let experiment = Experiment::siso(SampleTime::new(0.01)?, &command, &response)?;
    let search = Search { max_delay: 20, ..Search::default() };
    let answer = Oestruc::default().estimate(&experiment, &search)?;
    println!(
        "{}: {:?} s, 95 % interval {:?} s",
        answer.outcome.name(),
        answer.delay_s,
        answer.ci95_s
    );

    // A log: every method on every pair, what the record shows, and the verdict.
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/two_inputs.csv");
    let job = Job {
        max_delay_s: Some(1.5),
        ..Job::new(vec![log::read(&file)?], ["heater", "fan"], ["temperature"])
    };
    let report = job.run()?;
    for pair in &report.pairs {
        println!(
            "{} to {}: {:?} s. {}",
            pair.input, pair.output, pair.verdict.delay_s, pair.verdict.why
        );
    }
    println!("\n{}", deadtime::report::terminal::short(&report).plain().trim_end());
    Ok(())
}
