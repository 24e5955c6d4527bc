//! The intermediate results of the methods, as curves of the page of an estimate.

use serde_json::{Value, json};

use super::series::{brief, briefly};
use deadtime_delay::report::Pair;
use deadtime_delay::{Correlated, Evidence, Phase, Scan};

/// Methods that read an answer off each curve, the first that answered is marked.
const OF_RESPONSE: &[&str] = &["threshold", "impulseest", "cusum"];
const OF_LOSS: &[&str] = &["arxstruc"];
const OF_CORRELATION: &[&str] = &["crosscorr"];

/// A view for each curve that there is.
pub(super) fn curves(pair: &Pair, evidence: &Evidence, step_s: f64) -> Vec<Value> {
    let output = if pair.output == "*" { "the states" } else { &pair.output };
    let draw = Draw { pair, name: format!("{} → {output}", pair.input), step_s };
    let response =
        evidence.response.as_ref().map(|r| draw.response(&r.values, &r.std, evidence.limit_std));
    let scan = evidence.scan.as_ref().map(|s| draw.scan(s));
    let correlation = evidence.correlation.as_ref().map(|c| draw.correlation(c));
    let phase = evidence.phase.as_ref().map(|p| draw.phase(p));
    response.into_iter().chain(scan.into_iter().flatten()).chain(correlation).chain(phase).collect()
}

struct Draw<'a> {
    pair: &'a Pair,
    name: String,
    step_s: f64,
}

fn all(values: &[f64]) -> Vec<Option<f64>> {
    briefly(values.iter().copied())
}

impl Draw<'_> {
    fn lags(&self, count: usize) -> Vec<Option<f64>> {
        (0..count).map(|lag| brief(lag as f64 * self.step_s)).collect()
    }

    /// The answer of the first of the methods that has one, as a point on the curve.
    fn answer(&self, of: &[&str], values: &[f64]) -> Option<Value> {
        let said = of.iter().find_map(|name| {
            self.pair.estimates.iter().find(|e| e.method == *name && e.raw_delay_s.is_some())
        })?;
        let at = (said.raw_delay_s? / self.step_s).round();
        let at = (at >= 0.0 && at < values.len() as f64).then_some(at as usize)?;
        let y: Vec<Option<f64>> = (0..values.len())
            .map(|lag| if lag == at { brief(values[lag]) } else { None })
            .collect();
        Some(
            json!({ "label": format!("answer of {}", said.method), "y": y, "color": "before", "points": "only" }),
        )
    }

    fn view(
        &self,
        curve: &str,
        about: &str,
        x: &Value,
        y: &Value,
        curves: Vec<Option<Value>>,
    ) -> Value {
        let curves: Vec<Value> = curves.into_iter().flatten().collect();
        json!({ "kind": "lines", "keys": [self.name, curve], "about": format!("{about}, {}", self.name), "x": x, "y": y, "curves": curves })
    }

    fn response(&self, values: &[f64], std: &[f64], limit: f64) -> Value {
        let ends = |sign: f64| std.iter().map(|s| brief(sign * limit * s)).collect::<Vec<_>>();
        let threshold = json!({ "label": format!("± {limit} standard deviations"), "y": vec![0.0; values.len()], "low": ends(-1.0), "high": ends(1.0), "color": "measured", "points": false });
        let curve = json!({ "label": "impulse response", "y": all(values), "color": "after" });
        let x = json!({ "label": "lag (s)", "values": self.lags(values.len()) });
        let curves = vec![Some(threshold), Some(curve), self.answer(OF_RESPONSE, values)];
        self.view(
            "impulse response",
            "Impulse response with the threshold",
            &x,
            &json!({ "label": "response" }),
            curves,
        )
    }

    fn scan(&self, scan: &Scan) -> [Value; 2] {
        let x = json!({ "label": "lag (s)", "values": self.lags(scan.loss.len()) });
        let loss =
            json!({ "label": "loss over the smallest", "y": all(&scan.loss), "color": "after" });
        let curves = vec![Some(loss), self.answer(OF_LOSS, &scan.loss)];
        let by_delay = self.view(
            "loss over the delay",
            "Loss of ARX models over the delay",
            &x,
            &json!({ "label": "loss", "log": true }),
            curves,
        );
        let probability =
            json!({ "label": "probability", "y": all(&scan.probability), "color": "after" });
        let curves = vec![Some(probability), self.answer(OF_LOSS, &scan.probability)];
        let y = json!({ "label": "probability", "range": [-0.02, 1.02] });
        [
            by_delay,
            self.view(
                "probability of the delay",
                "Probability of each delay by ARX models",
                &x,
                &y,
                curves,
            ),
        ]
    }

    fn correlation(&self, found: &Correlated) -> Value {
        let count = found.coefficient.len();
        let chance = brief(found.chance);
        let band = json!({ "label": "by chance, 95 %", "y": vec![0.0; count], "low": vec![chance.map(|c| -c); count], "high": vec![chance; count], "color": "measured", "points": false });
        let curve =
            json!({ "label": "correlation", "y": all(&found.coefficient), "color": "after" });
        let x = json!({ "label": "lag (s)", "values": self.lags(count) });
        let curves = vec![Some(band), Some(curve), self.answer(OF_CORRELATION, &found.coefficient)];
        self.view(
            "correlation",
            "Correlation of input and output",
            &x,
            &json!({ "label": "correlation" }),
            curves,
        )
    }

    fn phase(&self, found: &Phase) -> Value {
        let line: Vec<f64> = found
            .frequency_hz
            .iter()
            .map(|f| -2.0 * std::f64::consts::PI * f * found.delay_s)
            .collect();
        let measured = json!({ "label": "phase", "y": all(&found.phase_rad), "color": "after", "points": "only" });
        let line = json!({ "label": format!("a pure delay of {} s", super::frame::number(Some(found.delay_s))), "y": all(&line), "color": "measured", "dash": [8, 5], "points": false });
        let x = json!({ "label": "frequency (Hz)", "values": all(&found.frequency_hz) });
        self.view(
            "phase",
            "Phase of the cross-spectrum where it is coherent",
            &x,
            &json!({ "label": "phase (rad)" }),
            vec![Some(measured), Some(line)],
        )
    }
}
