//! A simulator behind a single call: an external program, a recorded run, or anything else that maps commands to outputs.

use std::collections::{HashMap, HashSet, VecDeque};
use std::fmt;
use std::ops::Range;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use nalgebra::DMatrix;
use sha2::{Digest, Sha256};

use super::error::SimulateError;
use super::simulator::{Port, Restart, Simulator};
use super::system::{Dynamics, System};
use deadtime_signal::stop::Stop;

/// A state whose initial value the user names.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Name and unit.
    pub port: Port,
    /// Its value at the start of a log.
    pub initial: f64,
    /// Its standard deviation; `None` for an unknown initial value.
    pub std: Option<f64>,
}

/// The channel names of a simulator in logs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Face {
    /// The name of the simulator.
    pub name: String,
    /// The inputs, in the order of the columns of `u`.
    pub inputs: Vec<Port>,
    /// The outputs, in the order of the columns of the result.
    pub outputs: Vec<Port>,
    /// The states of `x0`, in order; may be empty.
    pub states: Vec<Start>,
    /// The parameters and their nominal values, in order; may be empty.
    pub parameters: Vec<(Port, f64)>,
    /// The log channels of the states; `None`: one start per log.
    pub restart: Option<Restart>,
}

impl Face {
    /// Refuses empty or duplicate names, and invalid initial values.
    fn check(&self) -> Result<(), SimulateError> {
        let Self { inputs, outputs, states, parameters, .. } = self;
        for (what, list) in [("input", inputs), ("output", outputs)] {
            if list.is_empty() {
                return Err(SimulateError::NoChannel { what });
            }
        }
        unique("input", inputs.iter())?;
        unique("output", outputs.iter())?;
        unique("state", states.iter().map(|s| &s.port))?;
        unique("parameter", parameters.iter().map(|p| &p.0))?;
        for state in states {
            let (name, std) = (&state.port.name, state.std.unwrap_or(0.0));
            if !state.initial.is_finite() {
                return Err(SimulateError::Value {
                    what: "the start",
                    name: name.clone(),
                    value: state.initial,
                });
            }
            if !(std.is_finite() && std >= 0.0) {
                return Err(SimulateError::Value {
                    what: "the standard deviation of the start",
                    name: name.clone(),
                    value: std,
                });
            }
        }
        if let Some(restart) = &self.restart {
            let needed = states.len();
            if restart.channels.len() != needed || restart.channels.iter().all(Option::is_none) {
                return Err(SimulateError::InitialState {
                    needed,
                    got: restart.channels.iter().flatten().count(),
                });
            }
            if let Some(every_s) = restart.every_s.filter(|s| !(s.is_finite() && *s > 0.0)) {
                return Err(SimulateError::Value {
                    what: "the time between two starts",
                    name: self.name.clone(),
                    value: every_s,
                });
            }
        }
        match parameters.iter().find(|p| !p.1.is_finite()) {
            Some((port, value)) => Err(SimulateError::Value {
                what: "the parameter",
                name: port.name.clone(),
                value: *value,
            }),
            None => Ok(()),
        }
    }
}

fn unique<'a>(
    what: &'static str,
    ports: impl Iterator<Item = &'a Port>,
) -> Result<(), SimulateError> {
    let mut known = HashSet::new();
    for port in ports {
        if port.name.is_empty() || !known.insert(port.name.as_str()) {
            return Err(SimulateError::Name { what, name: port.name.clone() });
        }
    }
    Ok(())
}

impl System {
    /// A black-box simulator, with the names of its channels.
    ///
    /// # Errors
    /// [`SimulateError`] for no input or output, a duplicate name, an initial value or parameter that is not finite, a negative standard deviation.
    pub fn black_box(simulator: Arc<dyn Simulator>, face: Face) -> Result<Self, SimulateError> {
        face.check()?;
        let Face { name, inputs, outputs, states, parameters, restart } = face;
        Ok(Self {
            name,
            input_delay_s: vec![0.0; inputs.len()],
            input_operating: vec![0.0; inputs.len()],
            output_operating: vec![0.0; outputs.len()],
            candidates: None,
            known: Vec::new(),
            restart,
            initial: states.iter().map(|s| s.initial).collect(),
            initial_std: states.iter().map(|s| s.std).collect(),
            dynamics: Dynamics::BlackBox(simulator, parameters.iter().map(|p| p.1).collect()),
            states: states.into_iter().map(|s| s.port).collect(),
            parameters: parameters.into_iter().map(|p| p.0).collect(),
            inputs,
            outputs,
        })
    }
}

/// The samples of one of several windows of equal length.
pub(crate) fn window(at: usize, windows: usize, samples: usize) -> Range<usize> {
    at * samples / windows..(at + 1) * samples / windows
}

/// Iterates over windows: one for every initial state in `x0`, a single one without states. In each, time starts at 0.
pub fn windows<E>(
    u: &DMatrix<f64>,
    time_s: &[f64],
    x0: &[f64],
    states: usize,
    mut each: impl FnMut(Range<usize>, &DMatrix<f64>, &[f64], &[f64]) -> Result<(), E>,
) -> Result<(), E> {
    let count = x0.len().checked_div(states).unwrap_or(1);
    if count <= 1 {
        return each(0..time_s.len(), u, time_s, x0);
    }
    for (at, x0) in x0.chunks_exact(states).enumerate() {
        let rows = window(at, count, time_s.len());
        let stamps: Vec<f64> =
            time_s[rows.clone()].iter().map(|t| t - time_s[rows.start]).collect();
        each(rows.clone(), &u.rows(rows.start, rows.len()).into_owned(), &stamps, x0)?;
    }
    Ok(())
}

/// Refuses a result of another shape, or one with NaN or infinity.
pub(super) fn check(
    answer: &DMatrix<f64>,
    outputs: &[Port],
    time_s: &[f64],
) -> Result<(), SimulateError> {
    let (needed, got) = ((time_s.len(), outputs.len()), answer.shape());
    if needed != got {
        return Err(SimulateError::Answer {
            rows: needed.0,
            columns: needed.1,
            got_rows: got.0,
            got_columns: got.1,
        });
    }
    let first = (0..needed.0)
        .find_map(|k| (0..needed.1).find(|&i| !answer[(k, i)].is_finite()).map(|i| (k, i)));
    first.map_or(Ok(()), |(sample, i)| {
        let (output, value) = (outputs[i].name.clone(), answer[(sample, i)]);
        Err(SimulateError::AnswerNotFinite { output, sample, time_s: time_s[sample], value })
    })
}

/// Bytes of cached results: thousands of runs of a typical log.
const BYTES: usize = 256 << 20;

/// A simulator with a cache of runs: no call is repeated, including failed ones. The cache checks for cancellation.
pub struct Remembered {
    inner: Arc<dyn Simulator>,
    outputs: Vec<Port>,
    stop: Stop,
    memory: Mutex<Answers>,
    done: Condvar,
}

type CallKey = [u8; 32];
type Answer = Result<DMatrix<f64>, String>;

#[derive(Default)]
struct Answers {
    answers: HashMap<CallKey, Answer>,
    /// Oldest first.
    order: VecDeque<CallKey>,
    bytes: usize,
    /// Calls running in other threads.
    running: HashSet<CallKey>,
    calls: usize,
    failed: usize,
    failure: Option<String>,
}

impl fmt::Debug for Remembered {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Remembered").field(&self.inner).finish()
    }
}

/// Removes a call from the running ones, however it ends.
struct Running<'a>(&'a Remembered, CallKey);

impl Drop for Running<'_> {
    fn drop(&mut self) {
        self.0.lock().running.remove(&self.1);
        self.0.done.notify_all();
    }
}

impl Remembered {
    /// A cache of the runs of a simulator with these outputs.
    #[must_use]
    pub fn new(inner: Arc<dyn Simulator>, outputs: Vec<Port>, stop: Stop) -> Self {
        Self { inner, outputs, stop, memory: Mutex::default(), done: Condvar::new() }
    }

    fn lock(&self) -> MutexGuard<'_, Answers> {
        self.memory.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Number of calls made.
    #[must_use]
    pub fn calls(&self) -> usize {
        self.lock().calls
    }

    /// Number of failed calls, and the last failure.
    #[must_use]
    pub fn failures(&self) -> (usize, Option<String>) {
        let memory = self.lock();
        (memory.failed, memory.failure.clone())
    }

    /// Makes the call, without looking it up in the cache.
    ///
    /// # Errors
    /// As [`Simulator::simulate`], and invalid results.
    pub fn call(&self, u: &DMatrix<f64>, time_s: &[f64], x0: &[f64], parameters: &[f64]) -> Answer {
        if self.stop.is_set() {
            return Err("nobody waits for the answer any more".to_owned());
        }
        self.lock().calls += 1;
        let answer = self.inner.simulate(u, time_s, x0, parameters);
        let answer = answer
            .and_then(|y| check(&y, &self.outputs, time_s).map(|()| y).map_err(|e| e.to_string()));
        if let Err(why) = &answer {
            let mut memory = self.lock();
            memory.failed += 1;
            memory.failure = Some(why.clone());
        }
        answer
    }
}

/// The key of a call: a hash of every input value.
fn key(u: &DMatrix<f64>, time_s: &[f64], x0: &[f64], parameters: &[f64]) -> CallKey {
    let mut hash = Sha256::new();
    for part in [u.as_slice(), time_s, x0, parameters] {
        hash.update(part.len().to_le_bytes());
        let mut bytes = Vec::with_capacity(8 * part.len());
        // Both zeros are the same value.
        part.iter().for_each(|v| bytes.extend_from_slice(&(v + 0.0).to_le_bytes()));
        hash.update(&bytes);
    }
    hash.finalize().into()
}

impl Simulator for Remembered {
    fn simulate(&self, u: &DMatrix<f64>, time_s: &[f64], x0: &[f64], parameters: &[f64]) -> Answer {
        let key = key(u, time_s, x0, parameters);
        let mut memory = self.lock();
        loop {
            if let Some(answer) = memory.answers.get(&key) {
                return answer.clone();
            }
            if memory.running.insert(key) {
                break;
            }
            memory = self.done.wait(memory).unwrap_or_else(PoisonError::into_inner);
        }
        drop(memory);
        let running = Running(self, key);
        let answer = self.call(u, time_s, x0, parameters);
        if !self.stop.is_set() {
            let size = |a: &Answer| a.as_ref().map_or(0, |y| 8 * y.len()) + size_of::<CallKey>();
            let mut memory = self.lock();
            memory.bytes += size(&answer);
            memory.answers.insert(key, answer.clone());
            memory.order.push_back(key);
            while memory.bytes > BYTES {
                let Some(oldest) = memory.order.pop_front() else { break };
                let gone = memory.answers.remove(&oldest).map_or(0, |a| size(&a));
                memory.bytes -= gone;
            }
        }
        drop(running);
        answer
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug)]
    struct Twice;

    impl Simulator for Twice {
        fn simulate(&self, u: &DMatrix<f64>, _: &[f64], _: &[f64], parameters: &[f64]) -> Answer {
            if parameters.first() == Some(&0.0) {
                Err("a division by 0".to_owned())
            } else {
                Ok(u * 2.0)
            }
        }
    }

    #[test]
    fn a_call_that_was_made_is_not_made_again_and_failures_are_counted() {
        let output = Port { name: "y".to_owned(), unit: None };
        let memory = Remembered::new(Arc::new(Twice), vec![output], Stop::default());
        let u = DMatrix::from_column_slice(2, 1, &[1.0, 2.0]);
        for _ in 0..3 {
            assert_eq!(
                memory.simulate(&u, &[0.0, 1.0], &[], &[]).unwrap(),
                DMatrix::from_column_slice(2, 1, &[2.0, 4.0])
            );
            assert!(memory.simulate(&u, &[0.0, 1.0], &[], &[0.0]).is_err());
        }
        assert_eq!(
            (memory.calls(), memory.failures()),
            (2, (1, Some("a division by 0".to_owned())))
        );
        let why = memory.simulate(&u, &[0.0, 1.0, 2.0], &[], &[]).unwrap_err();
        assert!(why.contains("2 × 1") && why.contains("3 × 1"), "{why}");
    }
}
