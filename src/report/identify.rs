//! A model from a log, as text and as data: `deadtime/identify@1`.

use serde_json::{Value, json};

use super::styled::cut;
use super::text::{Table, estimate};
use deadtime_delay::Comparison;
use deadtime_identify::Parametric;
use deadtime_identify::subspace::{Fit, Identified, OutputCheck, Recordings, Response, Root, Test};

/// Frequencies of every response.
pub(super) const FREQUENCIES: usize = 40;

/// The identified model, its logs, and its fit on held-out data.
pub struct Report<'a> {
    /// The logs.
    pub logs: Vec<String>,
    /// The model.
    pub model: &'a Identified,
    /// Delay of each input, samples.
    pub delays: &'a [usize],
    /// Where the delays come from, a sentence each.
    pub delay_notes: Vec<String>,
    /// The data of the checks.
    pub held_out: String,
    /// Samples that the checks were made on.
    pub held_out_samples: usize,
    /// Every output on data that the model has not seen.
    pub checks: Vec<OutputCheck>,
    /// Those data, the inputs behind their delays.
    pub judged: &'a Recordings,
    /// The comparison that chose the method.
    pub compared: Option<&'a Comparison>,
}

impl Report<'_> {
    /// `deadtime/identify@1`.
    ///
    /// # Errors
    /// [`deadtime_model::ModelError`] where the responses cannot be had.
    pub fn data(&self) -> Result<Value, deadtime_model::ModelError> {
        let m = self.model;
        let responses: Vec<Response> = m.responses(self.delays, FREQUENCIES)?;
        let rows = |m: &nalgebra::DMatrix<f64>| {
            m.row_iter().map(|r| r.iter().copied().collect::<Vec<_>>()).collect::<Vec<_>>()
        };
        let mut data = json!({
            "format": "deadtime/identify@1", "logs": self.logs, "method": m.method, "sample_time_s": m.sample_time.seconds(),
            "inputs": m.inputs, "outputs": m.outputs, "past": m.past, "rows": m.rows, "order": m.order,
            "input_delay_s": self.delays.iter().map(|d| m.sample_time.to_seconds(*d as f64)).collect::<Vec<_>>(), "delay_notes": self.delay_notes,
            "model": { "A": rows(&m.model.a), "B": rows(&m.model.b), "C": rows(&m.model.c), "D": rows(&m.model.d), "K": rows(&m.model.k),
                       "innovations_covariance": rows(&m.innovations),
                       "operating": { "inputs": m.scales.inputs.iter().map(|s| s.0).collect::<Vec<_>>(), "outputs": m.scales.outputs.iter().map(|s| s.0).collect::<Vec<_>>() },
                       "deviations": m.deviations() },
            "poles": m.poles(), "zeros": m.zeros(), "frequency_responses": responses,
            "held_out": { "data": self.held_out, "samples": self.held_out_samples, "outputs": self.checks }, "notes": m.notes,
        });
        if let (Some(compared), Some(object)) = (self.compared, data.as_object_mut()) {
            object.insert("compared".to_owned(), json!(compared));
        }
        if let (Some(p), Some(object)) = (&m.parametric, data.as_object_mut()) {
            object.insert("structure".to_owned(), json!(p.structure));
            object.insert("parameters".to_owned(), json!(p.parameters));
            object.insert("noise".to_owned(), json!({ "d": p.noise }));
            object.insert("first_guesses".to_owned(), json!(p.guesses));
        }
        Ok(data)
    }

    /// For a terminal.
    #[must_use]
    pub fn text(&self) -> String {
        let compared = self.compared.map(|c| self.comparison(c)).unwrap_or_default();
        compared + &self.text_of_model()
    }

    /// Every model that was tried, one row each.
    fn comparison(&self, compared: &Comparison) -> String {
        let kind = if compared.free_run { "free run" } else { "one step ahead" };
        format!(
            "Compared on validation data ({kind}); chosen: the fewest parameters within the noise of the best fit\n{}\n",
            candidates(compared, REASON)
        )
    }

    fn text_of_model(&self) -> String {
        let m = self.model;
        let order = &m.order;
        if let Some(p) = &m.parametric {
            return self.text_of(p);
        }
        let mut text = format!(
            "{}: order {} ({}), past window {} samples, {} rows, sample time {}\n",
            m.method,
            order.order,
            order.sure,
            m.past,
            m.rows,
            seconds(m.sample_time.seconds())
        );
        for (input, delay) in m.inputs.iter().zip(self.delays) {
            text += &format!(
                "  {}: dead time {} removed before the states are identified\n",
                input.name,
                seconds(m.sample_time.to_seconds(*delay as f64))
            );
        }
        for note in self.delay_notes.iter().chain(&m.notes) {
            text += &format!("  note: {note}\n");
        }
        text += &format!(
            "\norders: {} by Schwarz's criterion, {} by Akaike's, {} by the largest gap of the singular values{}\n",
            order.by_schwarz,
            order.by_akaike,
            order.by_gap,
            order.by_free_run.map_or_else(String::new, |n| format!(", {n} by free runs"))
        );
        text += &format!("{}\n", self.orders());
        text +=
            &format!("poles (z plane, standard deviations in brackets)\n{}\n", poles(&m.poles()));
        text += &format!(
            "on held-out data ({}, {} samples)\n{}",
            self.held_out,
            self.held_out_samples,
            self.fits()
        );
        text += &self.about_fits();
        text
    }

    /// For a terminal, of a model whose structure was given.
    fn text_of(&self, p: &Parametric) -> String {
        let m = self.model;
        let mut text = format!(
            "{}: {}\n  {} rows, sample time {}\n",
            m.method,
            p.structure,
            m.rows,
            seconds(m.sample_time.seconds())
        );
        for note in self.delay_notes.iter().chain(&m.notes) {
            text += &format!("  note: {note}\n");
        }
        text += &format!("\n{}\n", parameters(p));
        if !p.guesses.is_empty() {
            text += &format!("first guesses of one lag, from the step response\n{}\n", guesses(p));
        }
        // The lags of a process model are among its numbers.
        if p.continuous.is_none() {
            text += &format!(
                "poles (z plane, standard deviations in brackets)\n{}\n",
                poles(&m.poles())
            );
        }
        text += &format!(
            "on held-out data ({}, {} samples)\n{}",
            self.held_out,
            self.held_out_samples,
            self.fits()
        );
        text += &self.about_fits();
        text
    }

    pub(super) fn orders(&self) -> Table {
        let mut table = Table::new(&["order", "singular value", "Schwarz", "weight"], &[]);
        for c in &self.model.order.candidates {
            let schwarz =
                c.schwarz.map_or_else(|| "no stable predictor".to_owned(), |s| format!("{s:.2}"));
            table.row(vec![
                c.order.to_string(),
                format!("{:.4}", c.singular_value),
                schwarz,
                format!("{:.3}", c.weight),
            ]);
        }
        table
    }

    pub(super) fn fits(&self) -> Table {
        let mut table = Table::new(
            &[
                "output",
                "one-step fit %",
                "simulation fit %",
                "VAF %",
                "nrmse",
                "p of whiteness",
                "least p of inputs",
            ],
            &[0],
        );
        let percent =
            |f: Option<Fit>| f.map_or_else(|| "-".to_owned(), |f| format!("{:.1}", f.fit_percent));
        let p = |t: Option<Test>| t.map_or_else(|| "-".to_owned(), |t| format!("{:.3}", t.p));
        for c in &self.checks {
            let whole = c.simulation.or(c.one_step);
            let worst = c.inputs.iter().map(|i| i.test).min_by(|a, b| a.p.total_cmp(&b.p));
            table.row(vec![
                c.output.clone(),
                percent(c.one_step),
                percent(c.simulation),
                whole.map_or_else(|| "-".to_owned(), |f| format!("{:.1}", f.vaf_percent)),
                whole.map_or_else(|| "-".to_owned(), |f| format!("{:.4}", f.nrmse)),
                p(c.white),
                p(worst),
            ]);
        }
        table
    }

    /// The meaning of the columns of the table of fits.
    pub(super) fn about_fits(&self) -> String {
        let still: Vec<String> = self
            .checks
            .iter()
            .filter(|c| c.stands_still)
            .map(|c| format!("`{}`", c.output))
            .collect();
        let still = match still.as_slice() {
            [] => String::new(),
            [one] => format!("{one} stands still in these data, so it has no fit.\n"),
            more => {
                format!("{} stand still in these data, so they have no fit.\n", more.join(", "))
            }
        };
        let moving = || self.checks.iter().filter(|c| !c.stands_still);
        let unstable = moving().next().is_some() && moving().all(|c| c.simulation.is_none());
        let note = if unstable {
            "VAF and nrmse are those of one-step predictions: there is no free run to compare.\n"
        } else {
            ""
        };
        format!(
            "{still}{note}A p below 0.01 rejects that one-step errors are white, or independent of the inputs: a larger model could explain more.\n"
        )
    }
}

/// Every tried model: dead time, order, parameters, fit, and its place.
pub(super) fn candidates(compared: &Comparison, longest: usize) -> Table {
    let headings = ["model", "dead time (s)", "order", "parameters", "fit %", ""];
    let mut table = Table::new(&headings, &[0, 5]);
    let none = || "–".to_owned();
    for c in &compared.candidates {
        let orders = c.options.get("nf").zip(c.options.get("nb"));
        let name =
            orders.map_or_else(|| c.method.to_owned(), |(f, b)| format!("{} {f}/{b}", c.method));
        let delays: Vec<String> = c.dead_time_s.iter().map(|s| digits(*s)).collect();
        let word = match &c.why_not {
            _ if c.chosen => "chosen".to_owned(),
            Some(why) => cut(why, longest),
            None if c.as_good_as_best => "within the noise".to_owned(),
            None => String::new(),
        };
        table.row(vec![
            name,
            if delays.is_empty() { none() } else { delays.join(", ") },
            c.order.map_or_else(none, |n| n.to_string()),
            c.parameters.map_or_else(none, |n| n.to_string()),
            c.fit_percent.map_or_else(none, |f| format!("{f:.1}")),
            word,
        ]);
    }
    table
}

/// Columns of the reason why a model is not eligible.
const REASON: usize = 60;

/// Every number with its standard deviation and interval.
pub(super) fn parameters(p: &Parametric) -> Table {
    let mut table = Table::new(&["parameter", "value", "std", "95 % from", "to", "unit"], &[0, 5]);
    let number = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), digits);
    for q in &p.parameters {
        let name =
            q.input.as_ref().map_or_else(|| q.name.clone(), |input| format!("{} {input}", q.name));
        let unit = q.unit.clone().unwrap_or_default();
        let (value, ends) =
            q.ci95.map_or_else(|| (digits(q.value), None), |ends| estimate(q.value, Some(ends)));
        let [from, to] = ends.unwrap_or_else(|| ["-".to_owned(), "-".to_owned()]);
        table.row(vec![name, value, number(q.std), from, to, unit]);
    }
    table
}

/// First guesses of a process model.
fn guesses(p: &Parametric) -> Table {
    let mut table = Table::new(&["by", "K", "T1, s", "dead time, s"], &[0]);
    for g in &p.guesses {
        table.row(vec![g.by.to_owned(), digits(g.gain), digits(g.lag_s), digits(g.dead_time_s)]);
    }
    table
}

/// Five digits of any number.
fn digits(value: f64) -> String {
    if value == 0.0 || (1e-3..1e6).contains(&value.abs()) {
        let decimals = 4 - value.abs().max(1e-3).log10().floor() as i32;
        format!("{value:.*}", usize::try_from(decimals.clamp(0, 7)).unwrap_or(0))
    } else {
        format!("{value:.4e}")
    }
}

pub(super) fn poles(roots: &[Root]) -> Table {
    let mut table = Table::new(&["pole", "size", "time constant", "frequency", "damping"], &[0]);
    let deviation = |s: Option<f64>| s.map_or_else(String::new, |s| format!(" ({s:.2e})"));
    for r in roots.iter().filter(|r| r.im >= 0.0) {
        let imaginary = if r.im == 0.0 {
            String::new()
        } else {
            format!(" ± {:.5}{} i", r.im, deviation(r.std_im))
        };
        table.row(vec![
            format!("{:.5}{}{imaginary}", r.re, deviation(r.std_re)),
            format!("{:.5}", r.re.hypot(r.im)),
            r.time_constant_s.map_or_else(
                || "-".to_owned(),
                |t| format!("{}{}", signed(t), deviation(r.time_constant_std_s)),
            ),
            r.frequency_hz.map_or_else(|| "-".to_owned(), |f| format!("{f:.4} Hz")),
            r.damping.map_or_else(|| "-".to_owned(), |d| format!("{d:.3}")),
        ]);
    }
    table
}

/// Five digits.
pub(super) fn seconds(value_s: f64) -> String {
    let digits = 4 - value_s.abs().max(1e-9).log10().floor() as i32;
    let decimals = usize::try_from(digits.clamp(0, 9)).unwrap_or(0);
    if value_s == 0.0 { "0 s".to_owned() } else { format!("{value_s:.decimals$} s") }
}

/// Seconds; of a growing pole the time in which it grows e-fold.
fn signed(time_constant_s: f64) -> String {
    if time_constant_s < 0.0 {
        format!("grows in {}", seconds(-time_constant_s))
    } else {
        seconds(time_constant_s)
    }
}
