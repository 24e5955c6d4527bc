//! Our side of `lab/peers`: reads one JSON request a line, does the computation `loops` times, answers with the seconds of one.
//!
//! Signals are files of little-endian f64; with `out` the result of the last run is written there in the same form.

use std::error::Error;
use std::hint::black_box;
use std::io::{BufRead, Write};
use std::time::Instant;

use deadtime::identify::{Initial, OutputError, Record, arx_scan, fir};
use deadtime::log::{ReadOptions, Topic, open, read};
use deadtime::model::c2d::{Conversion, ZeroOrderHold};
use deadtime::model::{StateSpace, dlqr, uav};
use deadtime::simulate::{Hold, Options, lsim};
use deadtime::time::SampleTime;
use nalgebra::DMatrix;

type Answer = Result<Vec<f64>, Box<dyn Error>>;

/// One computation to time.
#[derive(serde::Deserialize)]
struct Request {
    task: String,
    #[serde(default)]
    u: String,
    #[serde(default)]
    y: String,
    #[serde(default)]
    a: Vec<Vec<f64>>,
    #[serde(default)]
    b: Vec<Vec<f64>>,
    #[serde(default)]
    c: Vec<Vec<f64>>,
    #[serde(default)]
    d: Vec<Vec<f64>>,
    #[serde(default)]
    q: Vec<Vec<f64>>,
    #[serde(default)]
    r: Vec<Vec<f64>>,
    #[serde(default)]
    ts: f64,
    #[serde(default)]
    hold: Hold,
    #[serde(default)]
    max_delay: usize,
    #[serde(default)]
    taps: usize,
    loops: u32,
    #[serde(default)]
    out: Option<String>,
}

fn matrix(rows: &[Vec<f64>]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), rows.first().map_or(0, Vec::len), |i, j| rows[i][j])
}

fn signal(path: &str) -> Result<Vec<f64>, Box<dyn Error>> {
    let bytes = std::fs::read(path)?;
    Ok(bytes
        .chunks_exact(8)
        .map(|c| f64::from_le_bytes(c.try_into().unwrap_or_default()))
        .collect())
}

/// Row after row, as numpy writes an array.
fn by_rows(m: &DMatrix<f64>) -> Vec<f64> {
    m.transpose().as_slice().to_vec()
}

/// A computation whose data is in memory.
type Task = Box<dyn Fn() -> Answer>;

/// The computation of a request, its data already in memory.
fn task(request: &Request) -> Result<Task, Box<dyn Error>> {
    for tasks in [of_models, of_records, of_files] {
        if let Some(task) = tasks(request)? {
            return Ok(task);
        }
    }
    Err(format!("there is no task `{}`", request.task).into())
}

/// Computations on models.
fn of_models(request: &Request) -> Result<Option<Task>, Box<dyn Error>> {
    let sample_time = || SampleTime::new(request.ts);
    Ok(Some(match request.task.as_str() {
        "c2d" => {
            let [a, b, c, d] = [&request.a, &request.b, &request.c, &request.d].map(|m| matrix(m));
            let (sys, ts) = (StateSpace::continuous(a, b, c, d)?, sample_time()?);
            Box::new(move || {
                let sampled = ZeroOrderHold::default().c2d(&sys, ts)?;
                Ok([sampled.a(), sampled.b()].iter().flat_map(|m| by_rows(m)).collect())
            })
        }
        "dlqr" => {
            let [a, b, q, r] = [&request.a, &request.b, &request.q, &request.r].map(|m| matrix(m));
            Box::new(move || Ok(by_rows(&dlqr(&a, &b, &q, &r, None)?.k)))
        }
        "lsim" => {
            let (sys, ts, u) = (uav::model(), sample_time()?, signal(&request.u)?);
            // One input after the other, as the matrix is stored.
            let u = DMatrix::from_vec(u.len() / sys.inputs(), sys.inputs(), u);
            let options = Options { hold: request.hold, ..Options::default() };
            Box::new(move || Ok(lsim(&sys, &u, ts, &options)?.y.data.into()))
        }
        _ => return Ok(None),
    }))
}

/// Estimates from one record.
fn of_records(request: &Request) -> Result<Option<Task>, Box<dyn Error>> {
    let records = || -> Result<_, Box<dyn Error>> {
        Ok([Record::new(signal(&request.u)?, signal(&request.y)?)])
    };
    let (max_delay, taps) = (request.max_delay, request.taps);
    Ok(Some(match request.task.as_str() {
        "arx" => {
            let records = records()?;
            Box::new(move || Ok(arx_scan(&records, 10, 5, max_delay).loss))
        }
        "oe" => {
            let records = records()?;
            let orders = OutputError { nb: 1, nf: 2, initial: Initial::Zero };
            Box::new(move || {
                Ok(orders
                    .scan(&records, max_delay)
                    .iter()
                    .map(|fit| fit.as_ref().map_or(f64::INFINITY, |fit| fit.loss))
                    .collect())
            })
        }
        "fir" => {
            let records = records()?;
            Box::new(move || {
                let fir = fir(&records, taps).ok_or("the input does not excite all taps")?;
                Ok(fir
                    .coefficients
                    .iter()
                    .chain(fir.covariance.diagonal().iter())
                    .copied()
                    .collect())
            })
        }
        _ => return Ok(None),
    }))
}

/// Readings of files.
fn of_files(request: &Request) -> Result<Option<Task>, Box<dyn Error>> {
    Ok(Some(match request.task.as_str() {
        "csv" => {
            let path = std::path::PathBuf::from(&request.u);
            // The sum of every channel: all of it was read.
            Box::new(move || {
                Ok(read(&path)?.channels().map(|c| c.samples().values.iter().sum()).collect())
            })
        }
        "recording" => {
            let path = std::path::PathBuf::from(&request.u);
            // One sum per topic.
            Box::new(move || {
                let recording = open(&path, &ReadOptions::default())?;
                let sum = |topic: &Topic| {
                    topic.log.channels().map(|c| c.iter().flatten().sum::<f64>()).sum()
                };
                Ok(recording.topics.iter().map(sum).collect())
            })
        }
        _ => return Ok(None),
    }))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut ready = std::collections::HashMap::new();
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let request: Request = serde_json::from_str(&line)?;
        // The same problem again: its data stay in memory.
        let key = line.split("\"loops\"").next().unwrap_or_default().to_owned();
        if !ready.contains_key(&key) {
            ready.insert(key.clone(), task(&request)?);
        }
        let run = &ready[&key];
        let start = Instant::now();
        let mut answer = Vec::new();
        for _ in 0..request.loops.max(1) {
            answer = black_box(run()?);
        }
        let seconds = start.elapsed().as_secs_f64() / f64::from(request.loops.max(1));
        if let Some(path) = &request.out {
            let bytes: Vec<u8> = answer.iter().flat_map(|v| v.to_le_bytes()).collect();
            std::fs::write(path, bytes)?;
        }
        println!("{}", serde_json::json!({ "seconds": seconds }));
        std::io::stdout().flush()?;
    }
    Ok(())
}
