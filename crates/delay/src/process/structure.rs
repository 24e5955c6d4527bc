//! The structure of a process model, and the meaning of its parameters.

use super::chain::{LEAST_RATIO, MOST_RATIO, REAL_RATIO, Shape};
use deadtime_identify::subspace::InnovationsModel;
use deadtime_model::c2d::{Conversion, ZeroOrderHold};
use deadtime_model::{Continuous, StateSpace};
use deadtime_signal::time::SampleTime;
use nalgebra::DMatrix;

/// The fitted structure.
#[derive(Debug, Clone, Copy)]
pub(super) struct ProcessStructure {
    pub(super) poles: usize,
    pub(super) zero: bool,
    pub(super) integrates: bool,
}

/// The parameters of a process model.
#[derive(Debug, Clone, Copy)]
pub(super) struct Numbers {
    gain: f64,
    /// T₁ + T₂ and T₁·T₂; for one pole T₁ and 0; for none zeros. s and s².
    lags: [f64; 2],
    zero_s: f64,
    delay_s: f64,
    /// The operating input minus the input mean of its record.
    pub(super) offset: f64,
}

impl ProcessStructure {
    /// The name of the corresponding method.
    pub(super) fn method(self) -> &'static str {
        match (self.integrates, self.poles, self.zero) {
            (true, 0, _) => "p0di",
            (true, ..) => "p1di",
            (_, 1, false) => "p1d",
            (_, 1, true) => "p1dz",
            (_, _, false) => "p2d",
            (_, _, true) => "p2dz",
        }
    }

    /// Without the integrator.
    pub(super) fn shape(self) -> Shape {
        Shape { poles: self.poles, zero: self.zero }
    }

    /// The parameters of fitted values; `step` is the sample time, s.
    pub(super) fn numbers(self, values: &[f64], step: f64, real: bool) -> Numbers {
        let (theta, rest) = values.split_at(self.poles);
        let lags = match theta {
            [sum, ratio, ..] => {
                let most = if real { REAL_RATIO } else { MOST_RATIO };
                let sum = sum.exp() * step;
                [sum, sum * sum * ratio.clamp(LEAST_RATIO, most)]
            }
            [one] => [one.exp() * step, 0.0],
            [] => [0.0; 2],
        };
        let gain = rest.get(1).copied().unwrap_or(0.0);
        let last = rest.get(2).copied().unwrap_or(0.0);
        let unit = if self.poles == 1 { lags[0] } else { lags[1].sqrt() };
        Numbers {
            gain: if self.integrates { gain / step } else { gain },
            lags,
            zero_s: if self.zero { last * unit / gain } else { 0.0 },
            delay_s: rest.first().copied().unwrap_or(0.0).max(0.0) * step,
            offset: if self.integrates { -last / gain } else { 0.0 },
        }
    }

    /// The model as a formula.
    pub(super) fn formula(self, complex: bool) -> String {
        let poles = match (self.poles, complex) {
            (0, _) => String::new(),
            (1, _) => "(1 + T1·s)".to_owned(),
            (_, false) => "((1 + T1·s)(1 + T2·s))".to_owned(),
            (_, true) => "(1 + 2·zeta·T·s + T²·s²)".to_owned(),
        };
        let zero = if self.zero { "·(1 + Tz·s)" } else { "" };
        let behind = match (self.integrates, poles.as_str()) {
            (true, "") => "s".to_owned(),
            (true, poles) => format!("(s{poles})"),
            (false, poles) => poles.to_owned(),
        };
        format!("K{zero}/{behind}·e^(−dead_time·s)")
    }
}

impl Numbers {
    /// The two poles are a complex pair.
    pub(super) fn is_complex(&self) -> bool {
        self.lags[1] > self.lags[0] * self.lags[0] * (REAL_RATIO + 1e-12)
    }

    /// Names, values and units of time or gain, in the order of the report.
    pub(super) fn list(
        &self,
        structure: ProcessStructure,
        complex: bool,
    ) -> Vec<(&'static str, f64)> {
        let [sum, product] = self.lags;
        let mut list = vec![("K", self.gain)];
        match (structure.poles, complex) {
            (0, _) => {}
            (1, _) => list.push(("T1", sum)),
            (_, false) => {
                let root = (sum * sum - 4.0 * product).max(0.0).sqrt();
                list.extend([("T1", 0.5 * (sum + root)), ("T2", 2.0 * product / (sum + root))]);
            }
            (_, true) => list.extend([("T", product.sqrt()), ("zeta", 0.5 * sum / product.sqrt())]),
        }
        if structure.zero {
            list.push(("Tz", self.zero_s));
        }
        list.push(("dead_time", self.delay_s));
        if structure.integrates {
            list.push(("u0", self.offset));
        }
        list
    }

    /// The model in continuous time; `None` where the parameters define none.
    pub(super) fn system(&self, structure: ProcessStructure) -> Option<StateSpace<Continuous>> {
        let ([sum, product], gain) = (self.lags, self.gain);
        let (a, b, c, d) = match (structure.poles, structure.integrates) {
            (0, _) => (vec![0.0], vec![1.0], vec![gain], 0.0),
            (1, true) => {
                (vec![0.0, 1.0, 0.0, -1.0 / sum], vec![0.0, 1.0 / sum], vec![gain, 0.0], 0.0)
            }
            (1, false) => (
                vec![-1.0 / sum],
                vec![1.0 / sum],
                vec![gain * (1.0 - self.zero_s / sum)],
                gain * self.zero_s / sum,
            ),
            _ => (
                vec![0.0, 1.0, -1.0 / product, -sum / product],
                vec![0.0, 1.0 / product],
                vec![gain, gain * self.zero_s],
                0.0,
            ),
        };
        let n = b.len();
        let matrix = |rows, columns, v: &[f64]| DMatrix::from_row_slice(rows, columns, v);
        let system = StateSpace::continuous(
            matrix(n, n, &a),
            matrix(n, 1, &b),
            matrix(1, n, &c),
            matrix(1, 1, &[d]),
        )
        .ok()?;
        system.with_input_delay(vec![self.delay_s]).ok()
    }
}

/// The model sampled behind a hold, and the whole samples of its delay.
pub(super) fn sampled(
    system: &StateSpace<Continuous>,
    step: SampleTime,
) -> Option<(InnovationsModel, Vec<usize>)> {
    let s = ZeroOrderHold::default().c2d(system, step).ok()?;
    let k = DMatrix::zeros(s.order(), 1);
    Some((
        InnovationsModel {
            a: s.a().clone(),
            b: s.b().clone(),
            c: s.c().clone(),
            d: s.d().clone(),
            k,
        },
        s.input_delay().to_vec(),
    ))
}

/// Units of the parameters of a process model.
pub(super) struct ProcessUnits<'a> {
    pub(super) input: Option<&'a str>,
    pub(super) output: Option<&'a str>,
    pub(super) integrates: bool,
}

impl ProcessUnits<'_> {
    /// The unit of a parameter, by its name.
    pub(super) fn of(&self, name: &str) -> Option<String> {
        match name {
            "zeta" => None,
            "K" => {
                let own = |unit: &str| {
                    if unit.chars().all(|c| c.is_alphanumeric() || c == '°' || c == '%') {
                        unit.to_owned()
                    } else {
                        format!("({unit})")
                    }
                };
                let ratio = match self.input? {
                    "1" => own(self.output?),
                    input => format!("{}/{}", own(self.output?), own(input)),
                };
                Some(if self.integrates { format!("{ratio}/s") } else { ratio })
            }
            "u0" => self.input.map(str::to_owned),
            _ => Some("s".to_owned()),
        }
    }
}
