//! Each found effect as a plot of its own law: output over input, force over state, delay over time, step response.
//!
//! The curves are the effects' own code, on a model that does nothing else.

use serde_json::{Value, json};

use super::series::{brief, briefly, labelled, picked};
use deadtime_gap::{Contribution, Diagnosed, FoundParameter};
use deadtime_model::effect::{Applied, Chance};
use deadtime_model::simulate::{Commands, Plan, System, Term};
use deadtime_model::{EffectEntry, ModelDocument, ModelFile};

/// Points of a curve.
const POINTS: usize = 401;

/// The figure; `None` where nothing that was found can be drawn.
pub(super) fn figure(d: &Diagnosed) -> Option<Value> {
    let views: Vec<Value> =
        d.diagnosis.cause.contributions.iter().filter_map(|c| drawn(c, d)).collect();
    picked("laws", &["effect"], views)
}

fn drawn(c: &Contribution, d: &Diagnosed) -> Option<Value> {
    let (mut view, about) = match c.effect.as_str() {
        "input_delay" | "output_delay" | "clock_offset" | "delay_jump" | "delay_drift" => {
            (over_time(c, d, "delay")?, "delay over time")
        }
        "gain_jump" => (over_time(c, d, "gain")?, "gain over time"),
        "parameter_jump" => (over_time(c, d, "value")?, "value over time"),
        "input_gain" | "input_curve" | "input_offset" | "deadband" | "backlash" | "saturation" => {
            (swept(c, range(d, c)?, false)?, "what comes out over what goes in")
        }
        "sensor_gain" | "sensor_bias" | "sensor_saturation" | "sensor_quantisation" => {
            (swept(c, range(d, c)?, true)?, "what comes out over what goes in")
        }
        "actuator_lag" | "rate_limit" => (stepped(c, range(d, c)?, false)?, "answer to a step"),
        "sensor_lag" => (stepped(c, range(d, c)?, true)?, "answer to a step"),
        "coulomb_friction" | "stribeck_friction" | "quadratic_drag" | "cubic_stiffness" => {
            (law(c, d)?, "what it adds to the derivative")
        }
        _ => return None,
    };
    view["kind"] = json!("lines");
    view["keys"] = json!([format!("{} on {}", c.effect, c.channel)]);
    view["about"] = json!(format!("{} on {}: {about}", c.effect, c.channel));
    Some(view)
}

fn parameter<'a>(c: &'a Contribution, name: &str) -> Option<&'a FoundParameter> {
    c.parameters.iter().find(|p| p.name == name)
}

fn between(from: f64, to: f64) -> Vec<f64> {
    (0..POINTS).map(|i| from + (to - from) * i as f64 / (POINTS - 1) as f64).collect()
}

/// A delay, a gain or a number of the model over the longest log; of a constant with its interval.
fn over_time(c: &Contribution, d: &Diagnosed, what: &str) -> Option<Value> {
    let end = d.traces.iter().filter_map(|t| t.time_s.last().copied()).fold(0.0, f64::max);
    let of = |name: &str| parameter(c, name).and_then(|p| p.value);
    let time_s = between(0.0, end);
    let (values, interval): (Vec<f64>, Option<[f64; 2]>) = match c.effect.as_str() {
        "delay_jump" | "gain_jump" | "parameter_jump" => {
            let (first, at, later) = (of(what)?, of("time")?, of("later")?);
            (time_s.iter().map(|t| if *t < at { first } else { later }).collect(), None)
        }
        "delay_drift" => {
            let (first, rate) = (of("delay")?, of("rate")?);
            (time_s.iter().map(|t| first + rate * t).collect(), None)
        }
        _ => {
            let [only] = c.parameters.as_slice() else { return None };
            (vec![only.value?; POINTS], only.ci95)
        }
    };
    let least = values.iter().copied().chain(interval.into_iter().flatten()).fold(0.0, f64::min);
    let most = values.iter().copied().chain(interval.into_iter().flatten()).fold(0.0, f64::max);
    let room = 0.1 * (most - least).max(1e-9);
    let unit = c.parameters.first().map(|p| p.unit.as_str());
    let mut curve = json!({ "label": what, "y": briefly(values), "color": "after", "points": false, "width": 2.2 });
    if let Some([low, high]) = interval {
        (curve["low"], curve["high"]) =
            (json!(vec![brief(low); POINTS]), json!(vec![brief(high); POINTS]));
    }
    Some(json!({
        "x": { "label": "time (s)", "values": briefly(time_s), "tight": true },
        "y": { "label": labelled(what, unit), "range": [least - if least < 0.0 { room } else { 0.0 }, most + room] }, "curves": [curve],
    }))
}

/// The smallest and largest value of the channel in the logs, and its unit; of `*` those of the first output.
fn range(d: &Diagnosed, c: &Contribution) -> Option<(f64, f64, Option<String>)> {
    let commands = d
        .commands
        .iter()
        .filter(|t| t.input == c.channel)
        .map(|t| (t.values.clone(), t.unit.clone()));
    let outputs = d
        .traces
        .iter()
        .filter(|t| t.output == c.channel || c.channel == "*")
        .map(|t| (t.measured.iter().flatten().copied().collect(), t.unit.clone()));
    let all: Vec<(Vec<f64>, Option<String>)> = commands.chain(outputs).collect();
    let ends = all
        .iter()
        .flat_map(|(v, _)| v)
        .filter(|v| v.is_finite())
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(*v), h.max(*v)]);
    (ends[0] < ends[1]).then(|| (ends[0], ends[1], all.first().and_then(|(_, unit)| unit.clone())))
}

/// The effect on a model that passes a command on, and has one constant state.
fn alone(c: &Contribution) -> Option<(System, Plan)> {
    let name = |of: &str| json!([{ "name": of, "unit": "1" }]);
    let file = json!({
        "format": "deadtime/model@1", "name": "alone", "kind": "lti", "inputs": name(&c.channel), "states": name(&c.channel),
        "outputs": name(&c.channel), "initial": [0.0], "initial_std": [0.0], "A": [[0.0]], "B": [[0.0]], "C": [[0.0]], "D": [[1.0]],
    });
    let file: ModelFile = serde_json::from_value(file).ok()?;
    let system = System::new(&ModelDocument::Lti(file), |_| Ok(0.0)).ok()?;
    let parameters = c.parameters.iter().map(|p| Some((p.name.clone(), p.value?)));
    let entry = EffectEntry {
        effect: c.effect.clone(),
        channel: c.channel.clone(),
        parameters: parameters.flatten().collect(),
    };
    let applied = Applied::from_entry(&system, &entry).ok()?;
    let plan = Applied::plan(&system, [&applied], Chance::Mean).ok()?;
    Some((system, plan))
}

fn out(system: &System, plan: &Plan, time_s: &[f64], u: Vec<f64>) -> Option<Vec<f64>> {
    let run =
        system.simulate(plan, Commands { time_s, inputs: &[u] }, &system.initial, None).ok()?;
    Some(run.y.column(0).iter().copied().collect())
}

fn label(name: &str, what: &str, unit: Option<&str>) -> String {
    labelled(&format!("{name}, {what}"), unit)
}

/// Slowly up and down again through the range that the logs have: what comes out, where the two ways differ in two curves.
fn swept(
    c: &Contribution,
    (low, high, unit): (f64, f64, Option<String>),
    output: bool,
) -> Option<Value> {
    let (system, plan) = alone(c)?;
    // Twice: the first pass fills the memory of the effect.
    let up = between(low, high);
    let way: Vec<f64> = [&up, &up.iter().rev().copied().collect::<Vec<_>>()]
        .into_iter()
        .flatten()
        .copied()
        .collect();
    let twice: Vec<f64> = way.iter().chain(&way).copied().collect();
    let time_s: Vec<f64> = (0..twice.len()).map(|k| k as f64).collect();
    let y = out(&system, &plan, &time_s, twice)?;
    let (rising, falling) = (
        y.get(2 * POINTS..3 * POINTS)?.to_vec(),
        y.get(3 * POINTS..)?.iter().rev().copied().collect::<Vec<f64>>(),
    );
    let same = rising.iter().zip(&falling).all(|(a, b)| (a - b).abs() <= 1e-9 * (high - low));
    let mut curves = vec![
        json!({ "label": "as it is", "y": briefly(up.iter().copied()), "color": "measured", "dash": [3, 4], "points": false }),
    ];
    curves.push(
        json!({ "label": if same { "out" } else { "out, rising" }, "y": briefly(rising), "color": "after", "points": false, "width": 2.2 }),
    );
    if !same {
        curves.push(json!({ "label": "out, falling", "y": briefly(falling), "color": "before", "points": false, "width": 2.2 }));
    }
    let (before, after) = if output { ("true", "measured") } else { ("commanded", "acting") };
    let unit = unit.as_deref();
    Some(json!({
        "x": { "label": label(&c.channel, before, unit), "values": briefly(up) }, "y": { "label": label(&c.channel, after, unit) }, "curves": curves,
    }))
}

/// A step over the range that the logs have.
fn stepped(
    c: &Contribution,
    (low, high, unit): (f64, f64, Option<String>),
    output: bool,
) -> Option<Value> {
    let (system, plan) = alone(c)?;
    let of = |name: &str| parameter(c, name).and_then(|p| p.value).filter(|v| *v > 0.0);
    let settles = of("time_constant")
        .map(|t| 6.0 * t)
        .or_else(|| of("rate").map(|r| 1.5 * (high - low) / r))
        .or_else(|| of("limit").map(|r| 1.5 * (high - low) / r))?;
    let time_s = between(0.0, 1.25 * settles);
    let u: Vec<f64> =
        time_s.iter().map(|t| if *t < 0.25 * settles { 0.0 } else { high - low }).collect();
    let y = out(&system, &plan, &time_s, u.clone())?;
    let shift = |v: f64| v - 0.25 * settles;
    Some(json!({
        "x": { "label": "time after the step (s)", "values": briefly(time_s.into_iter().map(shift)) },
        "y": { "label": label(&c.channel, "change", unit.as_deref()) },
        "curves": [
            { "label": if output { "true" } else { "commanded" }, "y": briefly(u), "color": "measured", "dash": [3, 4], "points": false },
            { "label": if output { "measured" } else { "acting" }, "y": briefly(y), "color": "after", "points": false, "width": 2.2 },
        ],
    }))
}

/// The effect's part of the state's derivative over the state, in the range of the output with the state's name, else from −1 to 1.
fn law(c: &Contribution, d: &Diagnosed) -> Option<Value> {
    let (_, plan) = alone(c)?;
    let known = range(d, c);
    let reach = known.as_ref().map_or(1.0, |(low, high, _)| low.abs().max(high.abs()));
    let of = |term: &Term, x: f64| match term {
        Term::Friction { level, .. } => Some(if x == 0.0 { 0.0 } else { -level * x.signum() }),
        Term::Function { f, .. } => Some(f(x)),
        Term::Constant { level, .. } => Some(*level),
        _ => None,
    };
    // Both sides of 0, for what jumps there.
    let mut x = between(-reach, reach);
    x.retain(|v| v.abs() > 1e-9 * reach);
    x.extend([-1e-6 * reach, 1e-6 * reach]);
    x.sort_by(f64::total_cmp);
    let y: Option<Vec<f64>> =
        x.iter().map(|v| plan.terms.iter().map(|t| of(t, *v)).sum()).collect();
    let unit = known.and_then(|(.., unit)| unit);
    Some(json!({
        "x": { "label": label(&c.channel, "the state", unit.as_deref()), "values": briefly(x) },
        "y": { "label": format!("added to the derivative of {}", c.channel) },
        "curves": [{ "label": c.effect, "y": briefly(y?), "color": "after", "points": false, "width": 2.2 }],
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_gap::{Share, Strength};

    fn found(effect: &str, parameters: &[(&str, f64)]) -> Contribution {
        let parameter = |(name, value): &(&str, f64)| {
            serde_json::from_value(
                json!({ "name": name, "unit": "1", "value": value, "std": null, "ci95": null }),
            )
            .unwrap()
        };
        Contribution {
            effect: effect.into(),
            channel: "u \"<b>\"".into(),
            parameters: parameters.iter().map(parameter).collect(),
            probability: None,
            strength: Strength::Clear,
            share: Share::default(),
            without_it: None,
            class: Vec::new(),
            surrogate: false,
        }
    }

    fn numbers(v: &Value) -> Vec<f64> {
        v.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    }

    #[test]
    fn a_deadband_is_flat_in_the_middle_and_backlash_goes_two_ways() {
        let view = swept(&found("deadband", &[("width", 0.5)]), (-2.0, 2.0, None), false).unwrap();
        assert_eq!(view["curves"].as_array().unwrap().len(), 2);
        for (x, y) in numbers(&view["x"]["values"]).iter().zip(numbers(&view["curves"][1]["y"])) {
            // sign(u)·max(|u| − width, 0)
            assert!((y - x.signum() * (x.abs() - 0.5).max(0.0)).abs() < 1e-4, "{x} {y}");
        }
        let view = swept(&found("backlash", &[("width", 0.4)]), (-2.0, 2.0, None), false).unwrap();
        let (rising, falling) =
            (numbers(&view["curves"][1]["y"]), numbers(&view["curves"][2]["y"]));
        // The play operator lags by its half-width either way.
        let between = falling[POINTS / 2] - rising[POINTS / 2];
        assert!((between - 2.0 * 0.4).abs() < 1e-3, "{between}");
    }

    #[test]
    fn a_lag_answers_a_step_by_two_thirds_after_its_time_constant() {
        let view =
            stepped(&found("actuator_lag", &[("time_constant", 0.2)]), (0.0, 3.0, None), false)
                .unwrap();
        let (t, y) = (numbers(&view["x"]["values"]), numbers(&view["curves"][1]["y"]));
        let at = t.iter().position(|t| *t >= 0.2).unwrap();
        assert!((y[at] / 3.0 - (1.0 - (-1.0_f64).exp())).abs() < 0.02, "{}", y[at]);
    }
}
