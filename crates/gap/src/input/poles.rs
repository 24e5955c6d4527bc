//! The poles of the nominal model: which do not decay within a log, and when the others have.

use nalgebra::DMatrix;

use super::black_box::Probed;
use super::record::LogRecord;
use deadtime_model::c2d::transition;
use deadtime_model::simulate::{Dynamics, Hold, Matrices, System};
use deadtime_model::{StateSpace, iterated_eigenvalues};
use deadtime_signal::stats;
use deadtime_signal::time::SampleTime;

/// The memory of the nominal model, from its poles.
#[derive(Debug, Clone)]
pub(crate) struct Poles {
    /// The slowest pole that does not decay within a log, as a phrase; `None` where all do.
    pub(crate) slow: Option<String>,
    /// Time in which the nominal model settles, seconds.
    pub(crate) settling_s: f64,
}

impl Poles {
    /// From a model that can be linearised.
    pub(crate) fn of(system: &System, records: &[LogRecord]) -> Self {
        let mut slowest: f64 = 0.0;
        let mut settling_s: f64 = 0.0;
        let mut slow = None;
        for record in records {
            let Ok(ts) = SampleTime::new(record.sample_time_s) else { continue };
            let Some([phi, ..]) = sampled(system, record, ts) else { continue };
            let limit = 1.0 - 1.0 / record.time_s.len() as f64;
            for z in iterated_eigenvalues(&phi).iter().map(|z| z.norm()) {
                if z >= limit && z > slowest {
                    slowest = z;
                    slow = Some(format!("a pole at |z| = {z:.4}"));
                }
                if z < 1.0 && z > 0.0 {
                    // 4 time constants, as long as that is less than the log.
                    settling_s = settling_s
                        .max((4.0 * record.sample_time_s / -z.ln()).min(0.1 * record.duration_s()));
                }
            }
        }
        Self { slow, settling_s }
    }

    /// From the calls of a simulator that can only be called.
    pub(crate) fn probed(probed: &Probed) -> Self {
        Self { slow: None, settling_s: probed.settling_s }
    }
}

/// The model about its start and the mean input, sampled every `ts`: Φ, Γ and C.
pub(crate) fn sampled(
    system: &System,
    record: &LogRecord,
    ts: SampleTime,
) -> Option<[DMatrix<f64>; 3]> {
    let continuous = |matrices: &Matrices| {
        let sys = StateSpace::continuous(
            matrices.a.clone(),
            matrices.b.clone(),
            matrices.c.clone(),
            matrices.d.clone(),
        )
        .ok()?;
        let (phi, gamma, _) = transition(sys.a(), sys.b(), ts.seconds(), Hold::Zero);
        phi.iter()
            .chain(gamma.iter())
            .all(|v| v.is_finite())
            .then(|| [phi, gamma, matrices.c.clone()])
    };
    match &system.dynamics {
        Dynamics::Sampled(matrices, _) => {
            Some([matrices.a.clone(), matrices.b.clone(), matrices.c.clone()])
        }
        Dynamics::Linear(matrices) => continuous(matrices),
        Dynamics::BlackBox(..) => None,
        Dynamics::Equations(equations, parameters) => {
            let mean = |u: &Vec<f64>| stats::mean(u.iter().copied()).unwrap_or(0.0);
            let u: Vec<f64> = record.inputs.iter().map(mean).collect();
            let at = equations.linearise(0.0, &system.initial, &u, parameters);
            continuous(&Matrices { a: at.a, b: at.b, c: at.c, d: at.d })
        }
    }
}
