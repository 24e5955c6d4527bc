//! Frequency responses from records: for a terminal, as a table of numbers, and as data: `deadtime/response@1`.

use std::fmt::Write as _;

use serde_json::{Value, json};

use super::identify::seconds;
use super::structured::digits;
use super::text::Table;
use deadtime_identify::response::{Point, Responses};

/// Rows of a table for people.
const ROWS: usize = 16;

/// The responses and the logs that they come from.
pub struct Report<'a> {
    /// The logs.
    pub logs: Vec<String>,
    /// The responses.
    pub responses: &'a Responses,
}

impl Report<'_> {
    /// `deadtime/response@1`: of every pair arrays over frequency; an interval of a phase that is not known is null.
    #[must_use]
    pub fn data(&self) -> Value {
        let r = self.responses;
        let pair = |(input, output): (usize, usize)| {
            let points = r.pair(output, input);
            let all = |of: &dyn Fn(&Point) -> Value| points.iter().map(of).collect::<Vec<Value>>();
            json!({
                "input": r.inputs[input].name, "output": r.outputs[output].name,
                "frequency_hz": all(&|p| json!(hz(p))), "real": all(&|p| json!(p.value.re)), "imag": all(&|p| json!(p.value.im)),
                "std": all(&|p| json!(p.std)), "coherence": all(&|p| json!(p.coherence)),
                "gain": all(&|p| json!(p.gain())), "gain_ci95": all(&|p| json!(p.gain_ci95())),
                "phase_rad": all(&|p| json!(p.phase_rad())), "phase_ci95_rad": all(&|p| json!(p.phase_ci95_rad())),
            })
        };
        json!({
            "format": "deadtime/response@1", "logs": self.logs, "method": r.method, "sample_time_s": r.sample_time.seconds(), "samples": r.samples,
            "inputs": r.inputs, "outputs": r.outputs, "references": r.references, "notes": r.notes,
            "responses": self.pairs().map(pair).collect::<Vec<_>>(),
        })
    }

    /// Every input with every output.
    pub fn pairs(&self) -> impl Iterator<Item = (usize, usize)> {
        let outputs = self.responses.outputs.len();
        (0..self.responses.inputs.len())
            .flat_map(move |input| (0..outputs).map(move |output| (input, output)))
    }

    /// For a terminal.
    #[must_use]
    pub fn text(&self) -> String {
        let r = self.responses;
        let mut text = format!("{}\n", self.headline());
        for note in &r.notes {
            let _ = writeln!(text, "  note: {note}");
        }
        for (input, output) in self.pairs() {
            let points = r.pair(output, input);
            let _ = write!(
                text,
                "\n{} → {}\n{}",
                r.inputs[input].name,
                r.outputs[output].name,
                table(&points)
            );
        }
        text + "\nBrackets hold 95 %. The response is that of samples: a zero-order hold at the input adds half a sample of delay.\n"
    }

    pub(super) fn headline(&self) -> String {
        let r = self.responses;
        let loops = if r.references.is_empty() {
            String::new()
        } else {
            format!(
                ", by way of {}",
                r.references.iter().map(|n| n.name.as_str()).collect::<Vec<_>>().join(", ")
            )
        };
        format!(
            "{}: {} frequencies from {} samples of {}{loops}",
            r.method,
            r.lines.len(),
            r.samples,
            seconds(r.sample_time.seconds())
        )
    }
}

fn hz(p: &Point) -> f64 {
    p.omega_rad_s / std::f64::consts::TAU
}

/// Some of the points, evenly in the logarithm of the frequency.
pub(super) fn table(points: &[Point]) -> Table {
    let mut table =
        Table::new(&["frequency (Hz)", "gain", "95 %", "phase (°)", "95 %", "coherence"], &[]);
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return table };
    let ratio = last.omega_rad_s / first.omega_rad_s;
    let mut before = None;
    for row in 0..ROWS {
        let wanted = first.omega_rad_s * ratio.powf(row as f64 / (ROWS - 1) as f64) * (1.0 - 1e-9);
        let at = points.partition_point(|p| p.omega_rad_s < wanted);
        let Some(p) = points.get(at).filter(|_| before != Some(at)) else { continue };
        before = Some(at);
        let [low, high] = p.gain_ci95();
        let phase = p.phase_ci95_rad().map_or_else(
            || "[not known]".to_owned(),
            |ends| format!("[{:.1}, {:.1}]", ends[0].to_degrees(), ends[1].to_degrees()),
        );
        table.row(vec![
            format!("{:.4}", hz(p)),
            digits(p.gain()),
            format!("[{}, {}]", digits(low), digits(high)),
            format!("{:.1}", p.phase_rad().to_degrees()),
            phase,
            format!("{:.3}", p.coherence),
        ]);
    }
    table
}

/// A table that `deadtime estimate --frf` reads, a row each frequency.
#[must_use]
pub fn csv(points: &[Point]) -> String {
    let mut text = "frequency [Hz],real,imag,std,coherence\n".to_owned();
    for p in points {
        let _ = writeln!(text, "{},{},{},{},{}", hz(p), p.value.re, p.value.im, p.std, p.coherence);
    }
    text
}
