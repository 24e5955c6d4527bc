//! The residual between measurement and model in four views: against the machine's motion, over frequency, against the commands, over time and frequency.

use std::collections::BTreeSet;
use std::f64::consts::TAU;

use serde_json::{Value, json};

use super::series::{base64, brief, briefly, labelled, picked};
use deadtime_gap::{CommandTrace, Diagnosed, Trace};
use deadtime_signal::CrossSpectra;
use deadtime_signal::stats;

/// Stretches of a variable's range.
const STRETCHES: usize = 16;
/// The fewest samples of one.
const FEWEST: usize = 8;
/// Lengths of a segment whose spectrum is taken, samples.
const SEGMENTS: [usize; 2] = [32, 1024];
/// Segments that a spectrum averages over, at least.
const AVERAGED: usize = 6;
/// Columns and rows of a map, and the logs that have one.
const COLUMNS: usize = 240;
const ROWS: usize = 24;
const MAPS: usize = 6;
/// The ratio to the noise with the full colour, dB.
const FULL_DB: f64 = 40.0;

/// All figures of a diagnosis; those that there is nothing for are left out.
pub(super) fn figures(d: &Diagnosed) -> Vec<Value> {
    let logs = d
        .traces
        .first()
        .map_or(0, |first| d.traces.iter().take_while(|t| t.output == first.output).count());
    if logs == 0 {
        return Vec::new();
    }
    let outputs: Vec<&[Trace]> = d.traces.chunks(logs).collect();
    let inputs: Vec<Vec<&CommandTrace>> = {
        let count = d.commands.len() / logs;
        (0..count)
            .map(|j| (0..logs).filter_map(|at| d.commands.get(at * count + j)).collect())
            .collect()
    };
    let against = outputs.iter().flat_map(|o| regimes(o, &outputs, &inputs)).collect();
    let spectra = outputs.iter().filter_map(|o| spectrum(o)).collect();
    let beside = outputs.iter().flat_map(|o| coherence(o, &inputs)).collect();
    let maps = outputs.iter().flat_map(|o| maps(o)).collect();
    let all = [
        picked("regimes", &["output", "against"], against),
        picked("spectrum", &["output"], spectra),
        picked("coherence", &["output", "command"], beside),
        picked("map", &["output", "log", "simulated"], maps),
    ];
    all.into_iter().flatten().collect()
}

/// The figures that there are.
pub(super) fn ids(figures: &[Value]) -> BTreeSet<&str> {
    figures.iter().filter_map(|f| f["id"].as_str()).collect()
}

/// Measured less predicted, before and after; `None` where either is missing.
fn left(t: &Trace, after: bool, at: usize) -> Option<f64> {
    let predicted = if after { t.after.as_deref()?.get(at) } else { t.before.get(at) };
    Some((*t.measured.get(at)?)? - predicted?).filter(|v| v.is_finite())
}

/// Root mean square of the residual in stretches of a variable, each with about as many samples, equal values together.
fn regimes(output: &[Trace], outputs: &[&[Trace]], inputs: &[Vec<&CommandTrace>]) -> Vec<Value> {
    let Some(first) = output.first() else { return Vec::new() };
    let commands = inputs.iter().filter_map(|logs| {
        let one = logs.first()?;
        let of = |log: usize, at: usize| logs.get(log).and_then(|c| c.values.get(at).copied());
        view(
            output,
            &format!("command {}", one.input),
            &labelled(&one.input, one.unit.as_deref()),
            &of,
        )
    });
    let measured = outputs.iter().filter_map(|logs| {
        let one = logs.first()?;
        let of = |log: usize, at: usize| {
            logs.get(log).and_then(|t| t.measured.get(at).copied().flatten())
        };
        view(
            output,
            &format!("measured {}", one.output),
            &labelled(&one.output, one.unit.as_deref()),
            &of,
        )
    });
    let slopes = outputs
        .iter()
        .filter(|logs| logs.first().is_some_and(|t| t.output == first.output))
        .filter_map(|logs| {
            let slope = |t: &Trace, at: usize| {
                let (from, to) = (at.checked_sub(1)?, at + 1);
                let rise = t.measured.get(to).copied().flatten()?
                    - t.measured.get(from).copied().flatten()?;
                Some(rise / (t.time_s.get(to)? - t.time_s.get(from)?))
            };
            let unit = first
                .unit
                .as_deref()
                .filter(|u| *u != "1")
                .map_or_else(|| "1/s".to_owned(), |u| format!("{u}/s"));
            view(
                output,
                &format!("slope of {}", first.output),
                &labelled(&format!("slope of {}", first.output), Some(&unit)),
                &|log, at| logs.get(log).and_then(|t| slope(t, at)),
            )
        });
    commands.chain(measured).chain(slopes).collect()
}

fn view(
    output: &[Trace],
    key: &str,
    label: &str,
    variable: &dyn Fn(usize, usize) -> Option<f64>,
) -> Option<Value> {
    let first = output.first()?;
    let with = output.iter().all(|t| t.after.is_some());
    let mut rows: Vec<(f64, f64, f64)> = Vec::new();
    for (log, t) in output.iter().enumerate() {
        for at in 0..t.time_s.len() {
            let Some((x, e)) = variable(log, at).filter(|v| v.is_finite()).zip(left(t, false, at))
            else {
                continue;
            };
            rows.push((x, e * e, left(t, true, at).map_or(0.0, |a| a * a)));
        }
    }
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let enough = (rows.len() / STRETCHES).max(FEWEST);
    let mut stretches: Vec<&[(f64, f64, f64)]> = Vec::new();
    let mut from = 0;
    for at in 1..=rows.len() {
        if at == rows.len() || (at - from >= enough && rows[at].0 > rows[at - 1].0) {
            stretches.push(&rows[from..at]);
            from = at;
        }
    }
    // One value has no variation to show.
    if stretches.len() < 2 {
        return None;
    }
    let of = |f: fn(&(f64, f64, f64)) -> f64| {
        stretches.iter().map(move |s| s.iter().map(f).sum::<f64>() / s.len().max(1) as f64)
    };
    let mut curves = vec![
        json!({ "label": "simulated", "y": briefly(of(|r| r.1).map(f64::sqrt)), "color": "before" }),
    ];
    if with {
        curves.push(json!({ "label": "with causes", "y": briefly(of(|r| r.2).map(f64::sqrt)), "color": "after", "dash": [7, 3] }));
    }
    curves.push(floor_line(first.floor, stretches.len()));
    Some(json!({
        "kind": "lines", "keys": [first.output, key], "about": format!("Residual of {} against {key}", first.output),
        "x": { "label": label, "values": briefly(of(|r| r.0)) }, "y": { "label": labelled("RMS residual", first.unit.as_deref()) }, "curves": curves,
    }))
}

fn floor_line(level: f64, count: usize) -> Value {
    json!({ "label": "noise floor", "y": vec![brief(level).filter(|v| *v > 0.0); count], "color": "measured", "dash": [3, 4], "points": false })
}

/// The sample time where all logs have one, the same.
fn step(output: &[Trace]) -> Option<f64> {
    let t = &output.iter().find(|t| t.time_s.len() > 2)?.time_s;
    let step = t[1] - t[0];
    let even = output
        .iter()
        .flat_map(|t| t.time_s.windows(2))
        .all(|w| (w[1] - w[0] - step).abs() <= 1e-3 * step);
    (even && step > 0.0).then_some(step)
}

/// The longest stretches without a missing value of any of several series.
fn stretches(count: usize, series: &[&dyn Fn(usize) -> Option<f64>]) -> Vec<Vec<Vec<f64>>> {
    let mut all = Vec::new();
    let mut now: Vec<Vec<f64>> = vec![Vec::new(); series.len()];
    for at in 0..=count {
        let row: Option<Vec<f64>> =
            if at < count { series.iter().map(|s| s(at)).collect() } else { None };
        match row {
            Some(row) => now.iter_mut().zip(row).for_each(|(list, v)| list.push(v)),
            None if now.first().is_some_and(|l| !l.is_empty()) => {
                all.push(std::mem::replace(&mut now, vec![Vec::new(); series.len()]))
            }
            None => {}
        }
    }
    all
}

/// Spectra of the pairs of series `a` and `b`, their means removed, over every stretch that holds a segment.
fn averaged(parts: &[Vec<Vec<f64>>], a: usize, b: usize) -> Option<CrossSpectra> {
    let samples: usize = parts.iter().filter_map(|p| p.first()).map(Vec::len).sum();
    let longest = parts.iter().filter_map(|p| p.first()).map(Vec::len).max()?;
    let wanted = (samples / AVERAGED).min(longest);
    if wanted < SEGMENTS[0] {
        return None;
    }
    let segment = (1_usize << wanted.ilog2()).min(SEGMENTS[1]);
    let mean = |i: usize| {
        stats::mean(parts.iter().filter_map(|p| p.get(i)).flatten().copied()).unwrap_or(0.0)
    };
    let (ma, mb) = (mean(a), mean(b));
    let centred = |v: &[f64], m: f64| v.iter().map(|v| v - m).collect::<Vec<f64>>();
    let pairs: Vec<(Vec<f64>, Vec<f64>)> = parts
        .iter()
        .filter(|p| p[a].len() >= segment)
        .map(|p| (centred(&p[a], ma), centred(&p[b], mb)))
        .collect();
    Some(CrossSpectra::welch(pairs.iter().map(|(a, b)| (a.as_slice(), b.as_slice())), segment))
}

fn hertz(s: &CrossSpectra, step_s: f64) -> Vec<Option<f64>> {
    briefly((1..s.uu.len()).map(|k| s.omega(k) / TAU / step_s))
}

/// Power densities of measurement and residual, before and after.
fn spectrum(output: &[Trace]) -> Option<Value> {
    let (first, step_s) = (output.first()?, step(output)?);
    let with = output.iter().all(|t| t.after.is_some());
    let parts = |t: &Trace| {
        let measured = |at: usize| t.measured.get(at).copied().flatten();
        let (before, after) = (
            |at: usize| left(t, false, at),
            |at: usize| if with { left(t, true, at) } else { Some(0.0) },
        );
        stretches(t.time_s.len(), &[&measured, &before, &after])
    };
    let parts: Vec<_> = output.iter().flat_map(parts).collect();
    let (one, two) = (averaged(&parts, 0, 1)?, averaged(&parts, 1, 2)?);
    let density = |s: &[f64]| briefly(s.iter().skip(1).map(|v| 2.0 * step_s * v));
    let x = hertz(&one, step_s);
    let mut curves = vec![
        json!({ "label": "measured", "y": density(&one.uu), "color": "measured", "points": false }),
        json!({ "label": "residual", "y": density(&one.yy), "color": "before", "points": false }),
    ];
    if with {
        curves.push(json!({ "label": "residual with causes", "y": density(&two.yy), "color": "after", "dash": [7, 3], "points": false }));
    }
    let mut floor = floor_line(2.0 * step_s * first.floor.powi(2), x.len());
    floor["label"] = json!("noise floor, if white");
    curves.push(floor);
    let unit = first.unit.as_deref().filter(|u| *u != "1").map_or_else(
        || "1/Hz".to_owned(),
        |u| {
            if u.chars().all(char::is_alphanumeric) {
                format!("{u}²/Hz")
            } else {
                format!("({u})²/Hz")
            }
        },
    );
    Some(json!({
        "kind": "lines", "keys": [first.output], "about": format!("Spectrum of {} and of its residual", first.output),
        "x": { "label": "frequency (Hz)", "log": true, "values": x }, "y": { "label": format!("power density ({unit})"), "log": true }, "curves": curves,
    }))
}

/// The coherence of the residual with each command, frequency by frequency: the part that a linear model could still explain.
fn coherence(output: &[Trace], inputs: &[Vec<&CommandTrace>]) -> Vec<Value> {
    let (Some(first), Some(step_s)) = (output.first(), step(output)) else { return Vec::new() };
    let with = output.iter().all(|t| t.after.is_some());
    let view = |logs: &Vec<&CommandTrace>| {
        let parts = output.iter().zip(logs).flat_map(|(t, c)| {
            let (before, after) = (
                |at: usize| left(t, false, at),
                |at: usize| if with { left(t, true, at) } else { Some(0.0) },
            );
            stretches(t.time_s.len(), &[&|at: usize| c.values.get(at).copied(), &before, &after])
        });
        let parts: Vec<_> = parts.collect();
        let (one, two) = (averaged(&parts, 0, 1)?, averaged(&parts, 0, 2)?);
        let lines = |s: &CrossSpectra| briefly(s.coherence().into_iter().skip(1));
        let mut curves = vec![
            json!({ "label": "residual", "y": lines(&one), "color": "before", "points": false }),
        ];
        if with {
            curves.push(json!({ "label": "residual with causes", "y": lines(&two), "color": "after", "dash": [7, 3], "points": false }));
        }
        // Of n independent looks chance gives more than 1 − 0.05^(1/(n−1)) once in twenty (Goodman 1957; Bendat and Piersol 2010, section 9.2.3).
        let chance = (one.looks > 1.5).then(|| 1.0 - 0.05_f64.powf(1.0 / (one.looks - 1.0)));
        let chance = vec![chance.and_then(brief); one.uu.len() - 1];
        curves.push(json!({ "label": "chance, 95 %", "y": chance, "color": "measured", "dash": [3, 4], "points": false }));
        Some(json!({
            "kind": "lines", "keys": [first.output, logs.first()?.input], "about": format!("Coherence of the residual of {} with {}", first.output, logs.first()?.input),
            "x": { "label": "frequency (Hz)", "log": true, "values": hertz(&one, step_s) }, "y": { "label": "coherence", "range": [-0.02, 1.02] }, "curves": curves,
        }))
    };
    inputs.iter().filter_map(view).collect()
}

/// Time by frequency: how far the residual is above a white noise of the floor's size, of the first logs.
fn maps(output: &[Trace]) -> Vec<Value> {
    let Some(step_s) = step(output) else { return Vec::new() };
    let mut views = Vec::new();
    for t in output.iter().take(MAPS) {
        for after in [false, true] {
            if !after || t.after.is_some() {
                views.extend(map(t, after, step_s));
            }
        }
    }
    views
}

/// A column of a map: the strongest line of every row, and the strongest of all with its frequency, Hz. A row between two lines is the nearer one's.
fn column(
    spectrum: Option<&CrossSpectra>,
    edges: &[f64],
    size: usize,
) -> (Option<Vec<f64>>, Option<(f64, f64)>) {
    let (Some(s), Some(&lowest)) = (spectrum, edges.first()) else { return (None, None) };
    let nearest = |hz: f64| ((hz / lowest).round() as usize).clamp(1, size / 2);
    let row = |ends: &[f64]| {
        let lines = nearest(ends[0])..=nearest(ends[1]);
        lines.filter_map(|k| s.uu.get(k).copied()).fold(0.0, f64::max)
    };
    let line = (1..s.uu.len()).map(|k| (s.uu[k], k as f64 * lowest));
    (Some(edges.windows(2).map(row).collect()), line.max_by(|a, b| a.0.total_cmp(&b.0)))
}

fn map(t: &Trace, after: bool, step_s: f64) -> Option<Value> {
    let samples = t.time_s.len();
    let size = (samples / COLUMNS)
        .max(samples / 40)
        .next_power_of_two()
        .clamp(SEGMENTS[0], SEGMENTS[1])
        .max((samples / COLUMNS).next_power_of_two());
    let columns = samples / size;
    if columns < 4 {
        return None;
    }
    let (lowest, highest) = (1.0 / (size as f64 * step_s), 0.5 / step_s);
    let edge = |r: usize| lowest * (highest / lowest).powf(r as f64 / ROWS as f64);
    let edges: Vec<f64> = (0..=ROWS).map(edge).collect();
    let part = |c: usize| -> Option<CrossSpectra> {
        let part: Vec<f64> =
            (c * size..(c + 1) * size).map(|at| left(t, after, at)).collect::<Option<_>>()?;
        Some(CrossSpectra::welch([(part.as_slice(), part.as_slice())], size))
    };
    let (powers, strongest): (Vec<_>, Vec<_>) =
        (0..columns).map(part).map(|s| column(s.as_ref(), &edges, size)).unzip();
    let most = powers.iter().flatten().flatten().copied().fold(0.0, f64::max);
    let level = if t.floor > 0.0 { t.floor.powi(2) } else { 1e-4 * most };
    if level <= 0.0 {
        return None;
    }
    let db = |p: f64| 10.0 * (p / level).log10();
    let shades = powers.iter().flat_map(|c| match c {
        // A line of noise alone is more than 3.6 dB above its mean in 10 % of the time; below 6 dB nothing is shown.
        Some(c) => c
            .iter()
            .map(|p| if db(*p) < 6.0 { 0 } else { (255.0 * db(*p) / FULL_DB).min(255.0) as u8 })
            .collect::<Vec<u8>>(),
        None => vec![0; ROWS],
    });
    let strongest: Vec<Option<f64>> = strongest
        .into_iter()
        .map(|s| s.filter(|s| db(s.0) >= 6.0).and_then(|s| brief(s.1)))
        .collect();
    let start = |c: usize| t.time_s.get(c * size).or(t.time_s.last()).copied();
    let times: Vec<f64> = (0..=columns).filter_map(start).collect();
    let middles = times.windows(2).map(|w| w[0].midpoint(w[1]));
    Some(json!({
        "kind": "lines", "keys": [t.output, t.log, if after { "with causes" } else { "as it came" }], "height": 340,
        "about": format!("Excess of the residual of {} over its noise, time by frequency", t.output),
        "x": { "label": "time (s)", "values": briefly(middles) }, "y": { "label": "frequency (Hz)", "log": true, "range": [lowest, highest] },
        "curves": [{ "label": "strongest at (Hz)", "y": strongest, "color": "ink", "points": "only" }],
        "map": { "x": briefly(times), "y": briefly(edges.iter().copied()), "u8": base64(shades) },
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A log of a residual that is 1 while the command is 1, and 0 otherwise. Its second half has a tone of 5 Hz. The causes explain all of the first part.
    fn trace() -> (Trace, CommandTrace) {
        let count = 4000_usize;
        let time_s: Vec<f64> = (0..count).map(|k| 0.01 * k as f64).collect();
        let values: Vec<f64> =
            (0..count).map(|k| f64::from(u8::from((k / 37).is_multiple_of(2)))).collect();
        let tone =
            |k: usize| if k >= count / 2 { 0.5 * (TAU * 5.0 * time_s[k]).sin() } else { 0.0 };
        let measured = (0..count).map(|k| Some(values[k] + tone(k)));
        let trace = Trace {
            log: "a".into(),
            output: "y".into(),
            unit: None,
            measured: measured.collect(),
            before: vec![0.0; count],
            after: Some(values.clone()),
            train: Some([0.0, 40.0]),
            held: None,
            floor: 0.01,
            time_s,
        };
        (trace, CommandTrace { log: "a".into(), input: "u".into(), unit: None, values })
    }

    fn numbers(v: &Value) -> Vec<f64> {
        v.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    }

    #[test]
    fn a_residual_that_goes_with_the_command_shows_against_it_and_in_the_coherence() {
        let (t, c) = trace();
        let views = regimes(std::slice::from_ref(&t), &[std::slice::from_ref(&t)], &[vec![&c]]);
        let against = views.iter().find(|v| v["keys"][1] == "command u").unwrap();
        assert_eq!(numbers(&against["x"]["values"]), [0.0, 1.0]);
        // Where the command is 0 only the tone is left, in half of the samples: 0.5/√2/√2.
        let (before, after) =
            (numbers(&against["curves"][0]["y"]), numbers(&against["curves"][1]["y"]));
        assert!(
            (before[0] - 0.25).abs() < 0.01 && before[1] > 1.0 && (after[1] - 0.25).abs() < 0.01,
            "{before:?} {after:?}"
        );
        let views = coherence(&[t], &[vec![&c]]);
        let (x, before, after) = (
            numbers(&views[0]["x"]["values"]),
            numbers(&views[0]["curves"][0]["y"]),
            numbers(&views[0]["curves"][1]["y"]),
        );
        // The command's own frequency is 1/0.74 s.
        let near = x
            .iter()
            .enumerate()
            .min_by(|a, b| (a.1 - 1.35).abs().total_cmp(&(b.1 - 1.35).abs()))
            .unwrap()
            .0;
        assert!(before[near] > 0.99 && after[near] < 0.5, "{} {}", before[near], after[near]);
    }

    #[test]
    fn a_tone_stands_in_the_spectrum_and_in_its_half_of_the_map() {
        let (t, _) = trace();
        let view = spectrum(std::slice::from_ref(&t)).unwrap();
        let (x, after) = (numbers(&view["x"]["values"]), numbers(&view["curves"][2]["y"]));
        let peak = (0..x.len()).max_by(|a, b| after[*a].total_cmp(&after[*b])).unwrap();
        assert!((x[peak] - 5.0).abs() < 0.3, "{}", x[peak]);
        // The area under the density is the mean square, 0.125 over half of the time.
        let area: f64 = after.iter().sum::<f64>() * (x[1] - x[0]);
        assert!((area - 0.0625).abs() < 0.005, "{area}");
        let map = map(&t, true, 0.01).unwrap();
        let strongest = map["curves"][0]["y"].as_array().unwrap();
        let (early, late) = strongest.split_at(strongest.len() / 2);
        assert!(early[..early.len() - 1].iter().all(Value::is_null), "{early:?}");
        assert!(
            late[1..].iter().all(|hz| (hz.as_f64().unwrap() / 5.0).ln().abs() < 0.2),
            "{late:?}"
        );
    }

    #[test]
    fn uneven_times_and_missing_samples_are_not_mistaken_for_spectra() {
        let (mut t, c) = trace();
        t.time_s[2000] += 0.004;
        assert!(
            spectrum(std::slice::from_ref(&t)).is_none()
                && coherence(&[t.clone()], &[vec![&c]]).is_empty()
                && maps(&[t.clone()]).is_empty()
        );
        let (mut t, _) = trace();
        t.measured.iter_mut().step_by(20).for_each(|m| *m = None);
        assert!(spectrum(&[t]).is_none(), "no stretch holds a segment");
    }
}
