//! Piecewise linear signals: the exact result of a held command behind an actuator.

/// Edges within this distance, relative to the sample, coincide.
pub(super) const TOGETHER: f64 = 1e-9;

/// One linear piece, v(t) = value + slope·(t − start) until the next piece starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Its start, s.
    pub start_s: f64,
    /// Its value there.
    pub value: f64,
    /// Its slope per second.
    pub slope: f64,
}

impl Piece {
    /// The value at a time inside the piece.
    #[must_use]
    pub fn at(&self, time_s: f64) -> f64 {
        self.value + self.slope * (time_s - self.start_s)
    }
}

/// A piecewise linear signal with jumps between the pieces, continuous from the right. Before the first piece it is constant; the last one never ends.
#[derive(Debug, Clone, PartialEq)]
pub struct Piecewise {
    pieces: Vec<Piece>,
}

impl Piecewise {
    /// Samples that are held until the next one.
    #[must_use]
    pub fn held(time_s: &[f64], values: impl IntoIterator<Item = f64>) -> Self {
        let mut pieces: Vec<Piece> = Vec::with_capacity(time_s.len());
        for (&start_s, value) in time_s.iter().zip(values) {
            // A repeated command value has no edge.
            if pieces.last().is_none_or(|before| before.value != value) {
                pieces.push(Piece { start_s, value, slope: 0.0 });
            }
        }
        Self { pieces }
    }

    /// Samples with linear interpolation.
    #[must_use]
    pub fn joined(time_s: &[f64], values: &[f64]) -> Self {
        let piece = |k: usize| {
            let slope = match (time_s.get(k + 1), values.get(k + 1)) {
                (Some(next), Some(value)) => (value - values[k]) / (next - time_s[k]),
                _ => 0.0,
            };
            Piece { start_s: time_s[k], value: values[k], slope }
        };
        Self { pieces: (0..time_s.len().min(values.len())).map(piece).collect() }
    }

    /// The pieces in order of time.
    #[must_use]
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// The value at the start of the first piece, also valid before it; 0 for a signal without pieces.
    #[must_use]
    pub fn first(&self) -> f64 {
        self.pieces.first().map_or(0.0, |p| p.value)
    }

    /// Every piece is constant.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.pieces.iter().all(|p| p.slope == 0.0)
    }

    /// The mean from each edge to the next, and the value at each edge but the last. A piece that crosses an edge by rounding alone is skipped.
    pub(super) fn sampled(&self, edges_s: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let count = edges_s.len().saturating_sub(1);
        let (mut means, mut values) = (Vec::with_capacity(count), Vec::with_capacity(count));
        let level = |value: f64| Piece { start_s: 0.0, value, slope: 0.0 };
        let mut at = 0;
        for edge in edges_s.windows(2) {
            let (from_s, to_s) = (edge[0], edge[1]);
            let together = TOGETHER * (to_s - from_s);
            while self.pieces.get(at + 1).is_some_and(|p| p.start_s <= from_s + together) {
                at += 1;
            }
            let mut piece = self.pieces.get(at).copied().unwrap_or(level(0.0));
            let mut next = at + 1;
            if piece.start_s > from_s + together {
                (piece, next) = (level(piece.value), at);
            }
            values.push(piece.at(from_s));
            let (mut sum, mut start_s) = (0.0, from_s);
            loop {
                let end_s = self.pieces.get(next).map_or(to_s, |p| p.start_s).clamp(start_s, to_s);
                let end_s = if to_s - end_s <= together { to_s } else { end_s };
                if start_s == from_s && end_s == to_s && piece.slope == 0.0 {
                    // The value itself, instead of a rounded quotient.
                    means.push(piece.value);
                    break;
                }
                sum += (end_s - start_s) * piece.at(0.5 * (start_s + end_s));
                if end_s == to_s {
                    means.push(sum / (to_s - from_s));
                    break;
                }
                start_s = end_s;
                piece = self.pieces[next];
                next += 1;
            }
        }
        (means, values)
    }

    /// The signal delayed by `delay_s`; its initial value holds until then. A negative delay looks ahead.
    #[must_use]
    pub fn delayed(mut self, delay_s: f64) -> Self {
        if delay_s == 0.0 {
            return self;
        }
        let Some(start_s) = self.pieces.first().map(|p| p.start_s) else { return self };
        for piece in &mut self.pieces {
            piece.start_s += delay_s;
        }
        if delay_s > 0.0 {
            // The first value holds from the start on.
            if self.pieces[0].slope == 0.0 {
                self.pieces[0].start_s = start_s;
            } else {
                self.pieces.insert(0, Piece { start_s, value: self.pieces[0].value, slope: 0.0 });
            }
            return self;
        }
        let gone = self.pieces.partition_point(|p| p.start_s <= start_s).saturating_sub(1);
        self.pieces.drain(..gone);
        let first = &mut self.pieces[0];
        if first.start_s < start_s {
            (first.value, first.start_s) = (first.at(start_s), start_s);
        }
        self
    }

    /// Values from their times of arrival on, in order of time; of several at one time the last.
    #[must_use]
    pub(super) fn arriving(arrivals: &[(f64, f64)]) -> Self {
        let mut pieces: Vec<Piece> = Vec::with_capacity(arrivals.len());
        for &(start_s, value) in arrivals {
            if pieces.last().is_some_and(|before| before.start_s == start_s) {
                pieces.pop();
            }
            if pieces.last().is_none_or(|before| before.value != value) {
                pieces.push(Piece { start_s, value, slope: 0.0 });
            }
        }
        Self { pieces }
    }

    /// The signal delayed by `before_s` until `time_s`, by `later_s` from then on.
    #[must_use]
    pub fn delayed_until(self, before_s: f64, time_s: f64, later_s: f64) -> Self {
        let later = self.clone().delayed(later_s);
        let mut pieces = self.delayed(before_s).pieces;
        let Some(start_s) = pieces.first().map(|p| p.start_s) else { return later };
        if time_s <= start_s {
            return later;
        }
        pieces.truncate(pieces.partition_point(|p| p.start_s < time_s));
        let next = later.pieces.partition_point(|p| p.start_s <= time_s);
        let held = |p: &Piece| Piece { start_s: time_s, value: p.at(time_s), slope: p.slope };
        pieces.extend(next.checked_sub(1).and_then(|at| later.pieces.get(at)).map(held));
        pieces.extend_from_slice(&later.pieces[next..]);
        Self { pieces }
    }

    /// Times `before` until `time_s`, times `later` from then on.
    #[must_use]
    pub fn scaled_until(mut self, before: f64, time_s: f64, later: f64) -> Self {
        let next = self.pieces.partition_point(|p| p.start_s < time_s);
        // A piece active at that time, or starting there, continues with the other gain.
        let runs = next > 0 && self.pieces.get(next).is_none_or(|p| p.start_s > time_s);
        if let Some(running) = next.checked_sub(1).filter(|_| runs).map(|at| self.pieces[at]) {
            self.pieces.insert(
                next,
                Piece { start_s: time_s, value: running.at(time_s), slope: running.slope },
            );
        }
        for (at, piece) in self.pieces.iter_mut().enumerate() {
            let gain = if at < next { before } else { later };
            (piece.value, piece.slope) = (gain * piece.value, gain * piece.slope);
        }
        self
    }

    /// The value at t is that of the signal at t − (delay_s + rate·t), never of a time after t. The signal's initial value holds until then. The rate is
    /// below 1.
    #[must_use]
    pub fn drifting(mut self, delay_s: f64, rate: f64) -> Self {
        let Some(start_s) = self.pieces.first().map(|p| p.start_s) else { return self };
        for piece in &mut self.pieces {
            let late_s = (piece.start_s + delay_s) / (1.0 - rate);
            // The delay changes the speed of the piece's own time.
            let pace = if late_s > piece.start_s { 1.0 - rate } else { 1.0 };
            (piece.start_s, piece.slope) = (late_s.max(piece.start_s), pace * piece.slope);
        }
        let first = &mut self.pieces[0];
        if first.slope == 0.0 {
            first.start_s = start_s;
        } else if first.start_s > start_s {
            let value = first.value;
            self.pieces.insert(0, Piece { start_s, value, slope: 0.0 });
        }
        self
    }

    /// The value of the signal at phase + n·period, held until the next of these times. The initial value holds until the first of them.
    #[must_use]
    pub fn passed_at(&self, period_s: f64, phase_s: f64) -> Self {
        if period_s <= 0.0 {
            return self.clone();
        }
        let mut pieces: Vec<Piece> = Vec::with_capacity(self.pieces.len());
        for (k, piece) in self.pieces.iter().enumerate() {
            // A command present at a passing time passes, with any rounding of its time.
            let turn = ((piece.start_s - phase_s) / period_s - TOGETHER).ceil();
            let passes_s = if k == 0 { piece.start_s } else { phase_s + turn * period_s };
            // A command replaced before a passing time never passes.
            while k > 0
                && pieces.len() > 1
                && pieces.last().is_some_and(|before| before.start_s >= passes_s)
            {
                pieces.pop();
            }
            pieces.push(Piece {
                start_s: passes_s.max(piece.start_s),
                value: piece.value,
                slope: 0.0,
            });
        }
        Self { pieces }
    }

    /// Replaces every value, and multiplies slopes by the second value of `f`. For maps that are linear on each piece.
    #[must_use]
    pub fn map(mut self, f: impl Fn(&Piece) -> (f64, f64)) -> Self {
        for piece in &mut self.pieces {
            (piece.value, piece.slope) = f(piece);
        }
        self
    }

    /// A memoryless map, linear between `kinks` (increasing): `f` gives value and local gain. Pieces are split at crossings of a kink.
    #[must_use]
    pub fn map_with_kinks(self, kinks: &[f64], f: impl Fn(f64) -> (f64, f64)) -> Self {
        if self.is_held() {
            return self.map(|p| (f(p.value).0, 0.0));
        }
        self.rebuild(|piece, end_s, out| {
            let mut cuts: Vec<f64> = kinks
                .iter()
                .map(|kink| piece.start_s + (kink - piece.value) / piece.slope)
                .filter(|t| piece.slope != 0.0 && *t > piece.start_s && *t < end_s)
                .collect();
            cuts.sort_by(f64::total_cmp);
            let ends = cuts.iter().copied().chain([end_s]);
            let mut start_s = piece.start_s;
            for end_s in ends {
                // The gain inside the piece: at a kink the map has two.
                let inside =
                    if end_s.is_finite() { 0.5 * (start_s + end_s) } else { start_s + 1.0 };
                let (value, gain) = (f(piece.at(start_s)).0, f(piece.at(inside)).1);
                out.push(Piece { start_s, value, slope: piece.slope * gain });
                start_s = end_s;
            }
        })
    }

    /// A new signal from each piece and its end time (infinite for the last): `build` appends the piece's image.
    #[must_use]
    pub fn rebuild(&self, mut build: impl FnMut(&Piece, f64, &mut Vec<Piece>)) -> Self {
        let mut out = Vec::with_capacity(self.pieces.len());
        for (k, piece) in self.pieces.iter().enumerate() {
            build(piece, self.pieces.get(k + 1).map_or(f64::INFINITY, |p| p.start_s), &mut out);
        }
        Self { pieces: out }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(signal: &Piecewise, t: f64) -> f64 {
        let k = signal.pieces.partition_point(|p| p.start_s <= t);
        if k == 0 { signal.first() } else { signal.pieces[k - 1].at(t) }
    }

    #[test]
    fn a_delay_holds_the_first_value_and_an_advance_looks_ahead() {
        let u = Piecewise::held(&[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]);
        let late = u.clone().delayed(0.25);
        assert_eq!(
            (at(&late, 0.1), at(&late, 1.2), at(&late, 1.25), at(&late, 9.0)),
            (3.0, 3.0, 4.0, 5.0)
        );
        let early = u.delayed(-1.5);
        assert_eq!(
            (early.pieces[0], at(&early, 0.4), at(&early, 0.5)),
            (Piece { start_s: 0.0, value: 4.0, slope: 0.0 }, 4.0, 5.0)
        );
    }

    #[test]
    fn means_over_samples_are_those_of_the_pieces_and_exact_where_one_piece_fills_a_sample() {
        let u = Piecewise::held(&[0.0, 0.1, 0.2, 0.3], [1.0, 3.0, -0.7, 0.1]);
        let edges = [0.0, 0.1, 0.2, 0.3, 0.5];
        assert_eq!(u.sampled(&edges), (vec![1.0, 3.0, -0.7, 0.1], vec![1.0, 3.0, -0.7, 0.1]));
        // A delay of whole samples moves them, to the bit; the last one, twice as long, contains two pieces.
        let moved = u.clone().delayed(0.1).sampled(&edges).0;
        assert_eq!(moved[..3], [1.0, 1.0, 3.0]);
        assert!((moved[3] + 0.3).abs() < 1e-14, "{moved:?}");
        let (means, values) = u.delayed(0.025).sampled(&edges);
        let expected = [
            1.0,
            0.25 * 1.0 + 0.75 * 3.0,
            0.25 * 3.0 - 0.75 * 0.7,
            (-0.025 * 0.7 + 0.175 * 0.1) / 0.2,
        ];
        assert!(means.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-14), "{means:?}");
        assert_eq!(values, [1.0, 1.0, 3.0, -0.7]);
        let ramp = Piecewise::joined(&[0.0, 1.0], &[0.0, 2.0]);
        assert_eq!(
            ramp.sampled(&[0.0, 0.5, 2.0]),
            (vec![0.5, (0.5 * 1.5 + 2.0) / 1.5], vec![0.0, 1.0])
        );
    }

    #[test]
    fn a_ramp_is_split_where_a_map_has_its_kinks() {
        let u = Piecewise::joined(&[0.0, 4.0], &[-2.0, 2.0]);
        let cut = u.map_with_kinks(&[-1.0, 1.0], |v| {
            if v.abs() > 1.0 { (v.signum(), 0.0) } else { (v, 1.0) }
        });
        for (t, expected) in
            [(0.0, -1.0), (0.5, -1.0), (1.5, -0.5), (2.0, 0.0), (3.5, 1.0), (4.0, 1.0)]
        {
            assert!((at(&cut, t) - expected).abs() < 1e-15, "at {t}: {}", at(&cut, t));
        }
    }
}
