//! Transfer functions with delay, for Simulink, MATLAB and python-control: the model with those of its effects that are linear.
//!
//! gain · numerator(s)/denominator(s) · e^(−delay·s) for every pair of input and output; in z where the model is sampled. Equations are linearised where a log
//! starts, with every input at 0.
//!
//! How it can be wrong: friction, dead zones and limits have no transfer function and are listed in `left_out`. A nonlinear model has another transfer function about
//! another operating point. A sensor clock that runs ahead makes a negative delay, which appears in `value_s` and in no formula.
//! Coefficients of many poles lose digits, so zeros, poles and gain are given as well.

use nalgebra::Complex;
use serde::{Deserialize, Serialize};

use super::node::Node;
use super::ranges::{Range, Ranges};
use super::source::{ExportError, Source};
use super::target::Target;
use crate::error::Result;
use deadtime_model::effect::{Applied, Chance};
use deadtime_model::simulate::{Dynamics, Matrices, Plan, Source as From, System, Term};
use deadtime_model::{
    Continuous, ModelDocument, ModelError, Sampled, StateSpace, TimeDomain, TransferFunction,
};

/// Transfer functions with delay.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Transfer {}

/// Effects that a transfer function can hold.
const LINEAR: [&str; 9] = [
    "input_delay",
    "input_gain",
    "actuator_lag",
    "parameter_error",
    "cross_coupling",
    "output_delay",
    "sensor_lag",
    "sensor_gain",
    "clock_offset",
];
/// Those of them that are impossible for a sampled model.
const LAGS: [&str; 2] = ["actuator_lag", "sensor_lag"];
/// Zeros and poles closer than this are one, and cancel.
const CANCELS: f64 = 1e-9;

impl Target for Transfer {
    fn export(&self, ranges: &Ranges, source: &Source<'_>) -> Result<Node> {
        let document =
            source.model.ok_or(ExportError::NeedsModel { target: "transfer-function" })?;
        if document.name() != source.diagnosis.model {
            let (model, diagnosed) = (document.name().to_owned(), source.diagnosis.model.clone());
            return Err(ExportError::OtherModel { model, diagnosed }.into());
        }
        let system = System::new(document, |_| Ok(0.0))?;
        let (effects, mut left_out) = linear_effects(document, &system)?;
        left_out.extend(found_only(document, ranges));
        let plan = Applied::plan(&system, &effects, Chance::Mean)?;
        let sample_time = match &plan.dynamics {
            Dynamics::Sampled(_, step) => step.seconds().into(),
            _ => Node::Null,
        };
        Ok(Node::map([
            ("format", "deadtime/transfer@1".into()),
            ("model", system.name.as_str().into()),
            ("sample_time_s", sample_time),
            ("linearised", matches!(plan.dynamics, Dynamics::Equations(..)).into()),
            ("functions", Node::List(functions(&plan, &system, ranges)?)),
            ("left_out", Node::List(left_out)),
        ]))
    }
}

/// The effects of the model that a transfer function can hold, and those that are left out, with the reason.
fn linear_effects(document: &ModelDocument, system: &System) -> Result<(Vec<Applied>, Vec<Node>)> {
    let (mut effects, mut left_out) = (Vec::new(), Vec::new());
    for entry in document.effects() {
        let sampled_lag = system.is_sampled() && LAGS.contains(&entry.effect.as_str());
        if LINEAR.contains(&entry.effect.as_str()) && !sampled_lag {
            effects.push(Applied::from_entry(system, entry)?);
        } else {
            let why = if sampled_lag {
                "a continuous lag before or behind a sampled model"
            } else {
                "it is not linear, or changes with time"
            };
            left_out.push(left_out_node(&entry.effect, &entry.channel, why));
        }
    }
    Ok((effects, left_out))
}

/// The effects with a range that the model does not have.
fn found_only(document: &ModelDocument, ranges: &Ranges) -> Vec<Node> {
    let mut named: Vec<(&str, &str)> =
        ranges.ranges.iter().map(|r| (r.effect.as_str(), r.channel.as_str())).collect();
    named.dedup();
    named.retain(|(effect, channel)| {
        !document.effects().iter().any(|e| e.effect == *effect && e.channel == *channel)
    });
    let why = "it was found, and the model that was given does not have it";
    named.into_iter().map(|(effect, channel)| left_out_node(effect, channel, why)).collect()
}

/// An entry of `left_out`.
fn left_out_node(effect: &str, channel: &str, why: &str) -> Node {
    Node::map([("effect", effect.into()), ("channel", channel.into()), ("why", why.into())])
}

/// The transfer functions of a plan between all inputs and outputs; equations are linearised at the initial state.
fn functions(plan: &Plan, system: &System, ranges: &Ranges) -> Result<Vec<Node>> {
    match &plan.dynamics {
        Dynamics::Sampled(matrices, step) => {
            pairs(&state_space(plan, matrices, Sampled(*step))?, system, plan, ranges)
        }
        Dynamics::Linear(matrices) => {
            pairs(&state_space(plan, matrices, Continuous)?, system, plan, ranges)
        }
        Dynamics::Equations(equations, parameters) => {
            let rest = vec![0.0; system.inputs.len()];
            let l = equations.linearise(0.0, &system.initial, &rest, parameters);
            if [&l.a, &l.b, &l.c, &l.d].iter().any(|m| m.iter().any(|v| !v.is_finite())) {
                return Err(ExportError::NoSlope { model: system.name.clone() }.into());
            }
            let matrices = Matrices { a: l.a, b: l.b, c: l.c, d: l.d };
            pairs(&state_space(plan, &matrices, Continuous)?, system, plan, ranges)
        }
        Dynamics::BlackBox(..) => Ok(Vec::new()),
    }
}

/// The matrices with the linear terms of a plan.
fn state_space<T: TimeDomain>(
    plan: &Plan,
    matrices: &Matrices,
    domain: T,
) -> Result<StateSpace<T>> {
    let (mut a, mut b) = (matrices.a.clone(), matrices.b.clone());
    for term in &plan.terms {
        match *term {
            Term::Linear { to, from: From::State(from), gain } => a[(to, from)] += gain,
            Term::Linear { to, from: From::Input(from), gain } => b[(to, from)] += gain,
            _ => {}
        }
    }
    Ok(StateSpace::new(a, b, matrices.c.clone(), matrices.d.clone(), domain)?)
}

/// The blocks before and behind the model on the path from one input to one output.
struct Way {
    gain: f64,
    lags_s: Vec<f64>,
    delay_s: f64,
    range_s: [f64; 2],
}

impl Way {
    fn of(plan: &Plan, system: &System, ranges: &Ranges, output: usize, input: usize) -> Self {
        let (before, behind) = (&plan.inputs[input], &plan.outputs[output]);
        let delay_s = before.delay_s + behind.delay_s + plan.clock.offset_s;
        let (u, y) = (&system.inputs[input].name, &system.outputs[output].name);
        let on_way = |r: &&Range| match r.effect.as_str() {
            "input_delay" => r.channel == *u,
            "output_delay" => r.channel == *y || r.channel == "*",
            effect => effect == "clock_offset",
        };
        let mut range_s = [delay_s; 2];
        for r in ["input_delay", "output_delay", "clock_offset"]
            .into_iter()
            .flat_map(|e| ranges.of(e))
            .filter(on_way)
        {
            range_s[0] += r.low - r.value;
            range_s[1] += r.high - r.value;
        }
        Self {
            gain: before.curve.map_or(1.0, |c| c.gain) * behind.slope,
            lags_s: before
                .lags_s
                .iter()
                .chain(&behind.lags_s)
                .copied()
                .filter(|t| *t > 0.0)
                .collect(),
            delay_s,
            range_s,
        }
    }
}

/// The transfer functions of a linear model between all inputs and outputs.
fn pairs<T: TimeDomain>(
    sys: &StateSpace<T>,
    system: &System,
    plan: &Plan,
    ranges: &Ranges,
) -> Result<Vec<Node>> {
    let mut functions = Vec::new();
    for (output, y) in system.outputs.iter().enumerate() {
        for (input, u) in system.inputs.iter().enumerate() {
            let way = Way::of(plan, system, ranges, output, input);
            let bare = match sys.transfer_function(output, input) {
                Ok(tf) => tf.cancelled(CANCELS),
                Err(ModelError::ZeroTransfer { .. }) => continue,
                Err(other) => return Err(other.into()),
            };
            let poles = bare
                .poles()
                .iter()
                .copied()
                .chain(way.lags_s.iter().map(|t| Complex::new(-1.0 / t, 0.0)))
                .collect();
            let gain = way.lags_s.iter().fold(bare.gain() * way.gain, |gain, t| gain / t);
            let tf = TransferFunction::from_zeros_poles_gain(
                bare.zeros().to_vec(),
                poles,
                gain,
                T::Delay::default(),
                bare.domain(),
            )?;
            functions.push(function(&u.name, &y.name, &tf, &way, sys.domain().sample_time_s()));
        }
    }
    Ok(functions)
}

fn function<T: TimeDomain>(
    input: &str,
    output: &str,
    tf: &TransferFunction<T>,
    way: &Way,
    step_s: Option<f64>,
) -> Node {
    let (numerator, denominator) = (tf.numerator(), tf.denominator());
    let complex =
        |list: &[Complex<f64>]| Node::List(list.iter().map(|c| vec![c.re, c.im].into()).collect());
    let delay = way.delay_s.max(0.0);
    let (list, step) = (
        |v: &[f64]| v.iter().map(|c| format!("{c:?}")).collect::<Vec<_>>(),
        step_s.map(|s| format!(", {s:?}")).unwrap_or_default(),
    );
    let (comma_n, comma_d) = (list(&numerator).join(", "), list(&denominator).join(", "));
    let (blank_n, blank_d) = (list(&numerator).join(" "), list(&denominator).join(" "));
    let control = match step_s {
        None if delay > 0.0 => format!(
            "control.tf([{comma_n}], [{comma_d}]) * control.tf(*control.pade({delay:?}, 5))"
        ),
        Some(s) if delay > 0.0 => {
            let samples = (delay / s).round();
            format!(
                "control.tf([{comma_n}], [{comma_d}], {s:?}) * control.tf([1], [1] + [0] * {samples}, {s:?})"
            )
        }
        _ => format!("control.tf([{comma_n}], [{comma_d}]{step})"),
    };
    let delay_of_matlab = match step_s {
        Some(s) => format!("{}", (delay / s).round()),
        None => format!("{delay:?}"),
    };
    Node::map([
        ("input", input.into()),
        ("output", output.into()),
        ("numerator", numerator.into()),
        ("denominator", denominator.into()),
        ("zeros", complex(tf.zeros())),
        ("poles", complex(tf.poles())),
        ("gain", tf.gain().into()),
        (
            "delay",
            Node::map([
                ("value_s", way.delay_s.into()),
                ("low_s", way.range_s[0].into()),
                ("high_s", way.range_s[1].into()),
            ]),
        ),
        (
            "matlab",
            format!("tf([{blank_n}], [{blank_d}]{step}, 'InputDelay', {delay_of_matlab})").into(),
        ),
        ("python_control", control.into()),
    ])
}
