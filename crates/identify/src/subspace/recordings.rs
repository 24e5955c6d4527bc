//! Several inputs and outputs over several records, scaled, and the triangular factor of their lagged samples.

use faer::Mat;
use nalgebra::{DMatrix, DVector};

use crate::error::IdentifyError;
use crate::error::Result;
use deadtime_log::Log;
use deadtime_signal::parallel;
use deadtime_signal::time::SampleTime;

/// A channel's name and unit.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Named {
    /// The name in the log.
    pub name: String,
    /// Its unit, where the log has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// A stretch of samples without a gap.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// Inputs, m × samples.
    pub u: DMatrix<f64>,
    /// Outputs, l × samples.
    pub y: DMatrix<f64>,
}

impl Stretch {
    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.u.ncols()
    }

    /// No samples.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Records of inputs and outputs on one even grid, in the channels' own units.
#[derive(Debug, Clone, PartialEq)]
pub struct Recordings {
    /// The sample time.
    pub sample_time: SampleTime,
    /// The inputs.
    pub inputs: Vec<Named>,
    /// The outputs.
    pub outputs: Vec<Named>,
    /// The samples; a missing output sample separates two stretches.
    pub stretches: Vec<Stretch>,
}

impl Recordings {
    /// The named channels of logs that share one even grid.
    ///
    /// # Errors
    /// [`deadtime_log::LogError`] for channels and time stamps, [`IdentifyError`] for names and sample times.
    pub fn from_logs(logs: &[Log], inputs: &[String], outputs: &[String]) -> Result<Self> {
        for (what, names) in [("input", inputs), ("output", outputs)] {
            if names.is_empty() {
                return Err(IdentifyError::NoChannel { what }.into());
            }
        }
        let all: Vec<&String> = inputs.iter().chain(outputs).collect();
        if let Some((_, twice)) = all.iter().enumerate().find(|(i, name)| all[..*i].contains(name))
        {
            return Err(IdentifyError::Twice { channel: (*twice).clone() }.into());
        }
        let mut sample_time: Option<SampleTime> = None;
        let mut stretches = Vec::new();
        for log in logs {
            let u = inputs
                .iter()
                .map(|name| log.input(name))
                .collect::<std::result::Result<Vec<_>, _>>()?;
            let y = outputs
                .iter()
                .map(|name| log.output(name))
                .collect::<std::result::Result<Vec<_>, _>>()?;
            let ts = log.even_grid()?;
            let first = *sample_time.get_or_insert(ts);
            if (ts.seconds() - first.seconds()).abs() > 1e-6 * first.seconds() {
                let file = log.source().to_owned();
                return Err(IdentifyError::SampleTimes {
                    file,
                    found_s: ts.seconds(),
                    first_s: first.seconds(),
                }
                .into());
            }
            let there: Vec<bool> =
                (0..log.len()).map(|k| y.iter().all(|y| y.get(k).is_some())).collect();
            let mut from = 0;
            for run in there.split(|there| !there) {
                let samples = run.len();
                if samples > 0 {
                    let u = DMatrix::from_fn(u.len(), samples, |i, k| u[i][from + k]);
                    let y = DMatrix::from_fn(y.len(), samples, |i, k| y[i].values[from + k]);
                    stretches.push(Stretch { u, y });
                }
                from += samples + 1;
            }
        }
        let unit = |name: &String| logs.iter().find_map(|log| log.unit(name)).map(str::to_owned);
        let named = |names: &[String]| {
            names.iter().map(|name| Named { name: name.clone(), unit: unit(name) }).collect()
        };
        let sample_time = sample_time.ok_or(IdentifyError::NoChannel { what: "log" })?;
        Ok(Self { sample_time, inputs: named(inputs), outputs: named(outputs), stretches })
    }

    /// Samples of all stretches.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.stretches.iter().map(Stretch::len).sum()
    }

    /// Rows with `past` samples before them.
    #[must_use]
    pub fn rows(&self, past: usize) -> usize {
        self.stretches.iter().map(|s| s.len().saturating_sub(past)).sum()
    }

    /// Each input delayed by its number of samples, as it acts behind its dead time; samples without an input are dropped.
    ///
    /// # Errors
    /// [`IdentifyError::Option`] for another number of delays.
    pub fn behind_delays(&self, delays: &[usize]) -> std::result::Result<Self, IdentifyError> {
        if delays.len() != self.inputs.len() {
            let rule = "one delay for each input";
            return Err(IdentifyError::Option {
                option: "number of input delays",
                value: delays.len() as f64,
                rule,
            });
        }
        let most = delays.iter().copied().max().unwrap_or(0);
        let moved = |s: &Stretch| {
            let samples = s.len() - most;
            Stretch {
                u: DMatrix::from_fn(s.u.nrows(), samples, |i, k| s.u[(i, k + most - delays[i])]),
                y: s.y.columns(most, samples).into_owned(),
            }
        };
        let stretches = self.stretches.iter().filter(|s| s.len() > most).map(moved).collect();
        Ok(Self { stretches, ..self.clone() })
    }

    /// The first share of every stretch, and the remainder.
    #[must_use]
    pub fn split(&self, share: f64) -> (Self, Self) {
        let cut = |s: &Stretch| ((s.len() as f64 * share).round() as usize).min(s.len());
        let part = |from: bool| {
            let stretch = |s: &Stretch| {
                let (at, n) = if from { (0, cut(s)) } else { (cut(s), s.len() - cut(s)) };
                Stretch { u: s.u.columns(at, n).into_owned(), y: s.y.columns(at, n).into_owned() }
            };
            Self {
                stretches: self.stretches.iter().map(stretch).filter(|s| !s.is_empty()).collect(),
                ..self.clone()
            }
        };
        (part(true), part(false))
    }

    /// Centre and spread of every channel over all samples.
    ///
    /// # Errors
    /// [`IdentifyError::Constant`].
    pub fn scales(&self) -> std::result::Result<Scales, IdentifyError> {
        let of = |names: &[Named], pick: fn(&Stretch) -> &DMatrix<f64>, remedy: &'static str| {
            let n = self.samples().max(1) as f64;
            let one = |(i, named): (usize, &Named)| {
                let values = || {
                    self.stretches
                        .iter()
                        .flat_map(move |s| pick(s).row(i).iter().copied().collect::<Vec<_>>())
                };
                let mean = values().sum::<f64>() / n;
                let spread = (values().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
                let first = values().next().unwrap_or(0.0);
                if values().all(|v| v == first)
                    || !(spread > 1e-14 * mean.abs() && spread.is_finite())
                {
                    return Err(IdentifyError::Constant { channel: named.name.clone(), remedy });
                }
                Ok((mean, spread))
            };
            names.iter().enumerate().map(one).collect::<std::result::Result<Vec<_>, _>>()
        };
        Ok(Scales {
            inputs: of(&self.inputs, |s| &s.u, "leave it out, or use a log in which it moves")?,
            outputs: of(
                &self.outputs,
                |s| &s.y,
                "leave it out, or use a log in which it responds",
            )?,
        })
    }

    /// The stretches in scaled units.
    pub(super) fn scaled(&self, scales: &Scales) -> Vec<Stretch> {
        self.stretches.iter().map(|s| scales.scaled(s)).collect()
    }

    /// The largest size of every output, scaled.
    pub(super) fn extent(&self, scales: &Scales) -> Vec<f64> {
        let largest = |(i, (centre, spread)): (usize, &(f64, f64))| {
            let values =
                self.stretches.iter().flat_map(|s| s.y.row(i).iter().copied().collect::<Vec<_>>());
            values.map(|y| ((y - centre) / spread).abs()).fold(0.0, f64::max)
        };
        scales.outputs.iter().enumerate().map(largest).collect()
    }

    /// The triangular factor of the lagged, scaled samples, each column minus its mean.
    #[must_use]
    pub(super) fn factor(&self, past: usize, scales: &Scales) -> Factor {
        let layout = self.layout(past);
        // Long enough that joining the factors costs little compared with their computation.
        let most = (16 * layout.columns()).max(8192);
        Factor::joined(layout, self.rows(past), self.blocks((past, past), most, scales))
    }

    fn layout(&self, past: usize) -> Layout {
        Layout { m: self.inputs.len(), l: self.outputs.len(), past }
    }

    /// Stretch, first sample and end of blocks of at most `most` samples, of each stretch from `first` on.
    pub(super) fn ranges(&self, first: usize, most: usize) -> Vec<(usize, usize, usize)> {
        let of = |(s, stretch): (usize, &Stretch)| {
            let end = stretch.len();
            (first..end)
                .step_by(most)
                .map(move |at| (s, at, (at + most).min(end)))
                .collect::<Vec<_>>()
        };
        self.stretches.iter().enumerate().flat_map(of).collect()
    }

    /// Triangular factors of the rows from `first` on, at least `past`, in blocks of at most `most` rows; a column of ones comes first.
    pub(super) fn blocks(
        &self,
        (past, first): (usize, usize),
        most: usize,
        scales: &Scales,
    ) -> Vec<Mat<f64>> {
        let layout = self.layout(past);
        let (m, q) = (layout.m, layout.columns());
        let scaled = self.scaled(scales);
        parallel::map(self.ranges(first, most), |(s, from, to)| {
            let Stretch { u, y } = &scaled[s];
            let rows = Mat::from_fn(to - from, q + 1, |row, column| {
                let Some(column) = column.checked_sub(1) else { return 1.0 };
                let (lag, within) = layout.place(column);
                let t = from + row - lag;
                if within < m { u[(within, t)] } else { y[(within - m, t)] }
            });
            triangle(&rows)
        })
    }
}

/// The upper triangular factor, with at most as many rows as columns.
pub(super) fn triangle(rows: &Mat<f64>) -> Mat<f64> {
    let qr = rows.qr();
    let r = qr.thin_R();
    Mat::from_fn(r.nrows(), r.ncols(), |i, j| if i <= j { r[(i, j)] } else { 0.0 })
}

/// Centre and standard deviation of every channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Scales {
    /// By input.
    pub inputs: Vec<(f64, f64)>,
    /// By output.
    pub outputs: Vec<(f64, f64)>,
}

impl Scales {
    pub(crate) fn scaled(&self, s: &Stretch) -> Stretch {
        let scaled = |m: &DMatrix<f64>, by: &[(f64, f64)]| {
            DMatrix::from_fn(m.nrows(), m.ncols(), |i, k| (m[(i, k)] - by[i].0) / by[i].1)
        };
        Stretch { u: scaled(&s.u, &self.inputs), y: scaled(&s.y, &self.outputs) }
    }

    /// The same spreads about other centres: the given deviations, in scaled units, from the present ones.
    pub(super) fn about(&self, (inputs, outputs): &(DVector<f64>, DVector<f64>)) -> Self {
        let moved = |scales: &[(f64, f64)], by: &DVector<f64>| {
            scales.iter().zip(by.iter()).map(|((c, s), d)| (c + s * d, *s)).collect()
        };
        Self { inputs: moved(&self.inputs, inputs), outputs: moved(&self.outputs, outputs) }
    }

    /// The deviations from the centres, in the channels' units.
    #[must_use]
    pub fn centred(&self, s: &Stretch) -> Stretch {
        let centred = |m: &DMatrix<f64>, by: &[(f64, f64)]| {
            DMatrix::from_fn(m.nrows(), m.ncols(), |i, k| m[(i, k)] - by[i].0)
        };
        Stretch { u: centred(&s.u, &self.inputs), y: centred(&s.y, &self.outputs) }
    }
}

/// The column layout: z(t−1) … z(t−p), u(t), y(t), with z = [u; y].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Layout {
    pub(super) m: usize,
    pub(super) l: usize,
    pub(super) past: usize,
}

impl Layout {
    /// Channels.
    pub(super) fn width(self) -> usize {
        self.m + self.l
    }
    /// Columns of z(t−1) … z(t−p).
    pub(super) fn window(self) -> usize {
        self.past * self.width()
    }
    pub(super) fn columns(self) -> usize {
        self.window() + self.width()
    }
    /// Lag and channel of a column.
    fn place(self, column: usize) -> (usize, usize) {
        let (lag, within) = (column / self.width(), column % self.width());
        (if lag == self.past { 0 } else { lag + 1 }, within)
    }
    /// Columns of z(t) … z(t−p+1), in the order of those of z(t−1) … z(t−p).
    pub(super) fn shifted(self) -> Vec<usize> {
        (self.window()..self.columns()).chain(0..self.window() - self.width()).collect()
    }
}

/// RᵀR = Σ over rows of the columns' products, each column minus its mean: a regression in it has a constant.
#[derive(Debug, Clone)]
pub(super) struct Factor {
    pub(super) layout: Layout,
    pub(super) rows: usize,
    pub(super) r: DMatrix<f64>,
    /// Means of the columns over the rows.
    pub(super) means: DVector<f64>,
}

impl Factor {
    /// The factor of the rows of all these factors, whose first column is ones.
    pub(super) fn joined(
        layout: Layout,
        rows: usize,
        factors: impl IntoIterator<Item = Mat<f64>>,
    ) -> Self {
        let q = layout.columns() + 1;
        let joined = factors.into_iter().reduce(|above, below| {
            let top = above.nrows();
            triangle(&Mat::from_fn(top + below.nrows(), q, |i, j| {
                if i < top { above[(i, j)] } else { below[(i - top, j)] }
            }))
        });
        let entry = |i: usize, j: usize| {
            joined.as_ref().filter(|r| i < r.nrows()).map_or(0.0, |r| r[(i, j)])
        };
        // Behind the ones, columns are centred.
        let r = DMatrix::from_fn(q - 1, q - 1, |i, j| entry(i + 1, j + 1));
        let one = entry(0, 0);
        let mean = |j: usize| if one == 0.0 { 0.0 } else { entry(0, j + 1) / one };
        Self { layout, rows, r, means: DVector::from_fn(q - 1, |j, _| mean(j)) }
    }

    /// The norm of a column including its mean: the scale of rounding.
    fn norm(&self, column: usize) -> f64 {
        self.r.column(column).norm().hypot(self.means[column] * (self.rows as f64).sqrt())
    }

    /// Those of the first `columns` columns that do not depend on previous ones.
    pub(super) fn independent(&self, columns: usize) -> Vec<usize> {
        (0..columns)
            .filter(|&j| self.r[(j, j)].abs() > REPEATED * self.norm(j).max(f64::MIN_POSITIVE))
            .collect()
    }

    /// x(t) = map·[z(t−1); …], rows by states.
    pub(super) fn states(&self, map: &DMatrix<f64>) -> DMatrix<f64> {
        self.r.columns(0, self.layout.window()) * map.transpose()
    }

    /// x(t+1) = map·[z(t); …], z(t) of the inputs and the given outputs.
    pub(super) fn next_states(&self, map: &DMatrix<f64>, y: &DMatrix<f64>) -> DMatrix<f64> {
        let (layout, width) = (self.layout, self.layout.width());
        let ahead = map.columns(width, map.ncols() - width);
        self.u() * map.columns(0, layout.m).transpose()
            + y * map.columns(layout.m, layout.l).transpose()
            + self.r.columns(0, layout.window() - width) * ahead.transpose()
    }

    /// y(t).
    pub(super) fn y(&self) -> DMatrix<f64> {
        let from = self.layout.window() + self.layout.m;
        self.r.columns(from, self.layout.l).into_owned()
    }
    /// u(t).
    pub(super) fn u(&self) -> DMatrix<f64> {
        self.r.columns(self.layout.window(), self.layout.m).into_owned()
    }

    /// The number of the input's own lags 1, 2, … that are independent of all previous inputs.
    ///
    /// # Errors
    /// [`IdentifyError::Collinear`] where an input is a combination of the others at the same sample.
    pub(super) fn excitation(
        &self,
        names: &[Named],
    ) -> std::result::Result<Vec<usize>, IdentifyError> {
        let Layout { m, past, .. } = self.layout;
        let width = self.layout.width();
        let lagged: Vec<usize> =
            (0..past).flat_map(|lag| (0..m).map(move |i| lag * width + i)).collect();
        let columns = self.r.select_columns(&lagged);
        let alone =
            triangle(&Mat::from_fn(columns.nrows(), columns.ncols(), |i, j| columns[(i, j)]));
        let seen =
            |j: usize| j < alone.nrows() && alone[(j, j)].abs() > RICH * self.norm(lagged[j]);
        if let Some(i) = (1..m).find(|&i| !seen(i)) {
            let others: Vec<&str> = names
                .iter()
                .enumerate()
                .filter(|(j, _)| *j != i)
                .map(|(_, n)| n.name.as_str())
                .collect();
            return Err(IdentifyError::Collinear {
                channel: names[i].name.clone(),
                others: others.join(", "),
            });
        }
        Ok((0..m).map(|i| (0..past).take_while(|lag| seen(lag * m + i)).count()).collect())
    }
}

/// A lag whose own part is below this share depends on the others.
const RICH: f64 = 1e-7;

/// Rounding of a triangular factor: a smaller part depends on the previous columns.
const REPEATED: f64 = 1e-9;
