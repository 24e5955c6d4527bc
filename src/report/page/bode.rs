//! Gain and phase over frequency, of one pair of channels.

use serde_json::{Value, json};

/// One response.
pub(super) struct Curve<'a> {
    /// Its label; `None` for a single curve.
    pub(super) label: Option<&'a str>,
    /// How it is drawn: `measured`, `before` or `after`.
    pub(super) color: &'a str,
    /// Gains, one a frequency.
    pub(super) gain: Vec<f64>,
    /// Ends of each gain's interval.
    pub(super) gain_ci95: Vec<Option<[f64; 2]>>,
    /// Phases, degrees, of any turn.
    pub(super) phase_deg: Vec<f64>,
    /// Ends of each phase's interval, in the phase's own turn.
    pub(super) phase_ci95_deg: Vec<Option<[f64; 2]>>,
}

/// A logarithm has no 0: lower ends of gains are drawn no further down than this share of the gain.
const LEAST: f64 = 1e-3;

/// The views of gain and of phase of the pair called `name`.
pub(super) fn views(name: &str, hz: &[f64], curves: &[Curve<'_>]) -> [Value; 2] {
    let view = |label: &str, log: bool, drawn: Vec<Value>| {
        json!({
            "kind": "lines", "keys": [name], "about": format!("{label} of {name} over frequency"),
            "x": { "label": "frequency (Hz)", "log": true, "values": hz }, "y": { "label": label, "log": log }, "curves": drawn,
        })
    };
    let drawn = |curve: &Curve<'_>, label: &str, values: &[f64], ends: Vec<Option<[f64; 2]>>| {
        let edge = |i: usize| ends.iter().map(|e| e.map(|e| e[i])).collect::<Vec<_>>();
        json!({ "label": curve.label.unwrap_or(label), "y": values, "low": edge(0), "high": edge(1), "color": curve.color, "points": false })
    };
    let gain = |c: &Curve<'_>| {
        let ends = c
            .gain_ci95
            .iter()
            .zip(&c.gain)
            .map(|(e, gain)| e.map(|[low, high]| [low.max(LEAST * gain), high]))
            .collect();
        drawn(c, "gain", &c.gain, ends)
    };
    // All curves begin in the turn of the first.
    let first = curves.first().and_then(|c| c.phase_deg.first()).copied().unwrap_or(0.0);
    let phase = |c: &Curve<'_>| {
        // Whole turns between neighbours are removed, from the interval too.
        let (mut turns, mut before) = (0.0, first);
        let turned = c.phase_deg.iter().zip(&c.phase_ci95_deg).map(|(own, ends)| {
            turns -= 360.0 * ((own + turns - before) / 360.0).round();
            before = own + turns;
            (before, ends.map(|ends| ends.map(|e| e + turns)))
        });
        let (middle, ends): (Vec<f64>, Vec<_>) = turned.unzip();
        drawn(c, "phase (°)", &middle, ends)
    };
    [
        view("gain", true, curves.iter().map(gain).collect()),
        view("phase (°)", false, curves.iter().map(phase).collect()),
    ]
}

/// The figures of gain and of phase, a view for each pair.
pub(super) fn figures(views: Vec<[Value; 2]>) -> Vec<Value> {
    if views.is_empty() {
        return Vec::new();
    }
    let (gains, phases): (Vec<Value>, Vec<Value>) =
        views.into_iter().map(|[gain, phase]| (gain, phase)).unzip();
    vec![
        json!({ "id": "gain", "pick": ["pair"], "views": gains }),
        json!({ "id": "phase", "pick": ["pair"], "views": phases }),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_phase_has_no_jumps_and_all_curves_begin_in_one_turn() {
        let curve = |phase_deg: &[f64]| Curve {
            label: None,
            color: "after",
            gain: vec![1.0; 3],
            gain_ci95: vec![Some([-1.0, 2.0]); 3],
            phase_deg: phase_deg.to_vec(),
            phase_ci95_deg: phase_deg.iter().map(|p| Some([p - 1.0, p + 1.0])).collect(),
        };
        let [gain, phase] = views(
            "u → y",
            &[1.0, 2.0, 3.0],
            &[curve(&[-170.0, 175.0, 100.0]), curve(&[185.0, 170.0, -260.0])],
        );
        assert_eq!(gain["curves"][0]["low"], json!([1e-3, 1e-3, 1e-3]));
        assert_eq!(phase["curves"][0]["y"], json!([-170.0, -185.0, -260.0]));
        assert_eq!(phase["curves"][1]["y"], json!([-175.0, -190.0, -260.0]));
        assert_eq!(phase["curves"][0]["high"], json!([-169.0, -184.0, -259.0]));
    }
}
