//! Delayed quantities inside a plant: v(t) = r(t − delay), with r stored as a curve over the length of the delay.
//!
//! Equation: r is the quartic through five values of a stretch of time without an edge of a signal. Stretches are at most as long as the delay, so that v is
//! known wherever the equations are integrated (method of steps). How it can be wrong: a value from the other side of an edge. The ends of a read stretch
//! select the curves.
//! Source: Bellen and Zennaro (2003), Numerical Methods for Delay Differential Equations, chapter 3.

use std::collections::VecDeque;

use super::piecewise::TOGETHER;

/// Times of the five values, relative to the length of a stretch.
pub(super) const NODES: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// A stretch of the curve of one quantity.
#[derive(Debug, Clone, PartialEq)]
struct Stretch {
    start_s: f64,
    length_s: f64,
    /// Newton's divided differences over `NODES`.
    differences: [f64; 5],
}

impl Stretch {
    fn through((start_s, end_s): (f64, f64), mut values: [f64; 5]) -> Self {
        for order in 1..values.len() {
            for i in (order..values.len()).rev() {
                values[i] = (values[i] - values[i - 1]) / (NODES[i] - NODES[i - order]);
            }
        }
        Self { start_s, length_s: end_s - start_s, differences: values }
    }

    fn at(&self, t: f64) -> f64 {
        let s = (t - self.start_s) / self.length_s;
        let nested = |sum: f64, (c, node): (&f64, &f64)| sum * (s - node) + c;
        self.differences.iter().zip(&NODES).rev().fold(0.0, nested)
    }
}

/// The past of one quantity.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct History {
    delay_s: f64,
    stretches: VecDeque<Stretch>,
    /// The first and the last readable stretch.
    open: (usize, usize),
}

impl History {
    /// For a quantity at rest at a value before time 0.
    pub(super) fn at_rest(delay_s: f64, value: f64) -> Self {
        let stretch = Stretch::through((-delay_s, 0.0), [value; 5]);
        Self { delay_s, stretches: VecDeque::from([stretch]), open: (0, 0) }
    }

    /// The stretch that contains a time.
    fn place(&self, t: f64) -> usize {
        self.stretches.partition_point(|s| s.start_s <= t).saturating_sub(1)
    }

    /// The delayed value at a time of the open stretch.
    pub(super) fn late(&self, t: f64) -> f64 {
        let (first, last) = self.open;
        let then = t - self.delay_s;
        let at = if first == last { first } else { self.place(then).clamp(first, last) };
        self.stretches.get(at).map_or(0.0, |stretch| stretch.at(then))
    }

    /// Opens the part between two times, at most a delay apart, for reading.
    fn open(&mut self, from_s: f64, to_s: f64) {
        let inside = 1e-6 * (to_s - from_s);
        let place = |t: f64| self.place(t - self.delay_s);
        self.open = (place(from_s + inside), place(to_s - inside));
    }

    fn push(&mut self, between: (f64, f64), values: [f64; 5]) {
        let oldest = between.1 - self.delay_s;
        while self.stretches.get(1).is_some_and(|next| next.start_s < oldest) {
            self.stretches.pop_front();
        }
        self.stretches.push_back(Stretch::through(between, values));
    }
}

/// All delayed quantities of a plant, and the times at which they may have jumped.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Histories {
    pub(super) quantities: Vec<History>,
    edges_s: VecDeque<f64>,
}

impl Histories {
    pub(super) fn new(quantities: Vec<History>) -> Self {
        Self { quantities, edges_s: VecDeque::new() }
    }

    /// A signal or the plant's state may jump here.
    pub(super) fn edge(&mut self, at_s: f64) {
        let delays = self.quantities.iter().map(|q| q.delay_s);
        let longest_s = delays.fold(0.0, f64::max);
        while self.edges_s.front().is_some_and(|edge| edge + 2.0 * longest_s < at_s) {
            self.edges_s.pop_front();
        }
        self.edges_s.push_back(at_s);
    }

    /// The end of the stretch that begins here: at most the shortest delay later, and before any next edge arrives. The stretch is opened for reading.
    pub(super) fn next(&mut self, from_s: f64, to_s: f64) -> f64 {
        let together = TOGETHER * (to_s - from_s);
        let shortest_s = self.quantities.iter().map(|q| q.delay_s).fold(f64::INFINITY, f64::min);
        let arrivals = (self.quantities.iter())
            .flat_map(|q| self.edges_s.iter().map(|edge| edge + q.delay_s))
            .filter(|at_s| *at_s > from_s + together);
        let end_s = arrivals.fold(to_s.min(from_s + shortest_s), f64::min);
        let end_s = if end_s > to_s - together { to_s } else { end_s };
        self.quantities.iter_mut().for_each(|q| q.open(from_s, end_s));
        end_s
    }

    /// Opens the end of the last stretch for reading: values that arrive there are valid from there on.
    pub(super) fn arrive(&mut self, at_s: f64) {
        self.quantities.iter_mut().for_each(|q| {
            let at = q.place(at_s - q.delay_s);
            q.open = (at, at);
        });
    }

    /// Stores the value of each quantity at the five nodes of a stretch.
    pub(super) fn push(&mut self, between: (f64, f64), values: &[[f64; 5]]) {
        self.quantities.iter_mut().zip(values).for_each(|(q, values)| q.push(between, *values));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quartic_comes_back_late_and_edges_keep_their_sides() {
        let r = |t: f64| if t < 0.5 { 1.0 - t.powi(4) } else { 7.0 + t.powi(3) };
        let mut late = Histories::new(vec![History::at_rest(0.2, 1.0)]);
        let mut now = 0.0;
        for (edge, end) in [(0.0, 0.5), (0.5, 0.9)] {
            late.edge(edge);
            now = edge;
            while now < end {
                let next = late.next(now, end);
                for node in [0.01, 0.5, 0.99] {
                    let t = now + node * (next - now);
                    let then = (t - 0.2).max(0.0);
                    assert!((late.quantities[0].late(t) - r(then)).abs() < 1e-9, "{t}");
                }
                // The side of each end that lies in the stretch.
                let own = |t: f64| if edge < 0.5 { 1.0 - t.powi(4) } else { 7.0 + t.powi(3) };
                let values = NODES.map(|node| own(now + node * (next - now)));
                late.push((now, next), &[values]);
                now = next;
            }
        }
        assert!(now == 0.9 && late.quantities[0].stretches.len() < 5);
    }
}
