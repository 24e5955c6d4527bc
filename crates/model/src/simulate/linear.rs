//! The exact step of a linear system with piecewise linear inputs.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use nalgebra::DMatrix;

use super::assembly::Assembly;
use super::error::SimulateError;
use super::walk::{Drive, Stepper};
use crate::matrix::exp;

/// Relative difference within which two step lengths are equal: time stamps such as 0.3 − 0.2 carry rounding.
const SAME: f64 = 1e-9;
/// Number of cached transitions: stamps rounded by a clock have about ten step lengths, with delays between them a few times as many.
const KEPT: usize = 32;
/// Number of uses from which a step length gets its own transition. The value is a choice: lengths not rounded by a clock seldom recur.
const OFTEN: usize = 8;
/// Below this norm of A·h the Taylor series needs at most eleven terms (‖A·h‖ᵏ/k! < 1e-17). At half of it ten suffice, which an additional step before it
/// outweighs.
const SERIES_LIMIT: f64 = 0.125;

/// Transitions of other runs that a thread caches; at most this number of states.
const CACHED: usize = 256;
const SMALL: usize = 16;

thread_local! {
    /// Runs of one model with other commands, delays or sensors have the same steps. The newest is last.
    static TRANSITIONS: RefCell<VecDeque<Remembered>> = const { RefCell::new(VecDeque::new()) };
}

/// A transition and everything that determines it.
struct Remembered {
    ramps: bool,
    derivative: Vec<f64>,
    transition: Rc<Transition>,
}

/// x(t + h) = Φ x + Γ v + Δ v′ for one h; matrices by columns.
struct Transition {
    h: f64,
    phi: Vec<f64>,
    /// One column per signal, then one for the constant 1.
    held: Vec<f64>,
    /// The same for slopes; empty if no signal has one.
    ramp: Vec<f64>,
}

/// The dynamics, constant until the next switch.
struct Law {
    /// By columns: states × (states + signals + 1).
    derivative: Vec<f64>,
    /// By rows: outputs × (states + signals + 1).
    output: Vec<f64>,
    norm: f64,
}

impl Law {
    fn of(assembly: &Assembly) -> Self {
        let n = assembly.states;
        let width = n + assembly.signals + 1;
        let mut derivative = vec![0.0; n * width];
        for (i, row) in assembly.derivatives.iter().enumerate() {
            for (j, value) in row[..width].iter().enumerate() {
                derivative[j * n + i] = *value;
            }
        }
        let output = assembly.outputs.iter().flat_map(|row| row[..width].iter().copied()).collect();
        let a = DMatrix::from_column_slice(n, n, &derivative[..n * n]);
        let sums = |by_row: bool| {
            let sum = |i: usize| {
                if by_row {
                    a.row(i).iter().map(|v| v.abs()).sum::<f64>()
                } else {
                    a.column(i).iter().map(|v| v.abs()).sum()
                }
            };
            (0..n).map(sum).fold(0.0, f64::max)
        };
        Self { derivative, output, norm: f64::min(sums(true), sums(false)) }
    }
}

/// A linear system during its simulation.
pub(super) struct Linear {
    plant: usize,
    states: usize,
    signals: usize,
    law: Law,
    /// From every switch on.
    later: Vec<Law>,
    ramps: bool,
    kept: Vec<Rc<Transition>>,
    /// Other lengths, and the number of uses of each.
    seen: Vec<(f64, usize)>,
    /// Over powers of two.
    powers: Vec<Rc<Transition>>,
    x: Vec<f64>,
    next: Vec<f64>,
    /// The contribution of constant signals and the constant over a step.
    forced: Vec<f64>,
    /// The transition and the levels of this contribution.
    forced_by: Option<usize>,
    levels: Vec<f64>,
    series: [Vec<f64>; 2],
}

impl Linear {
    /// The system, its dynamics from every switch on, and whether a signal has slopes.
    pub(super) fn new(assembly: &Assembly, later: &[Assembly], ramps: bool) -> Self {
        let (n, m) = (assembly.states, assembly.signals);
        Self {
            plant: assembly.plant,
            states: n,
            signals: m,
            law: Law::of(assembly),
            later: later.iter().map(Law::of).collect(),
            ramps,
            kept: Vec::new(),
            seen: Vec::new(),
            powers: Vec::new(),
            x: assembly.start.clone(),
            next: vec![0.0; n],
            forced: vec![0.0; n],
            forced_by: None,
            levels: vec![0.0; m],
            series: [vec![0.0; n], vec![0.0; n]],
        }
    }

    /// All states.
    pub(super) fn state(&self) -> &[f64] {
        &self.x
    }

    /// The transition over h, if this length recurs often enough.
    fn transition(&mut self, h: f64) -> Option<usize> {
        let same = |other: f64| (other - h).abs() <= SAME * h;
        if let Some(at) = self.kept.iter().position(|t| same(t.h)) {
            return Some(at);
        }
        if self.kept.len() == KEPT {
            return None;
        }
        match self.seen.iter_mut().find(|(length, _)| same(*length)) {
            Some((_, times)) if *times < OFTEN => *times += 1,
            Some(_) => {
                let transition = self.known(h);
                self.kept.push(transition);
                return Some(self.kept.len() - 1);
            }
            None => {
                if self.seen.len() == KEPT {
                    self.seen.clear();
                }
                self.seen.push((h, 1));
            }
        }
        None
    }

    /// The transition over h, from an earlier run with the same step if there is one.
    #[allow(clippy::float_cmp)] // the same bits
    fn known(&self, h: f64) -> Rc<Transition> {
        if self.states > SMALL {
            return Rc::new(self.dense(h));
        }
        let same = |r: &Remembered| {
            r.transition.h == h && r.ramps == self.ramps && r.derivative == self.law.derivative
        };
        TRANSITIONS.with_borrow_mut(|all| {
            if let Some(found) = all.iter().rev().find(|r| same(r)) {
                return Rc::clone(&found.transition);
            }
            let transition = Rc::new(self.dense(h));
            if all.len() == CACHED {
                all.pop_front();
            }
            all.push_back(Remembered {
                ramps: self.ramps,
                derivative: self.law.derivative.clone(),
                transition: Rc::clone(&transition),
            });
            transition
        })
    }

    fn dense(&self, h: f64) -> Transition {
        let (n, inputs) = (self.states, self.signals + 1);
        let size = n + if self.ramps { 2 * inputs } else { inputs };
        let mut block = DMatrix::zeros(size, size);
        for j in 0..n + inputs {
            for i in 0..n {
                block[(i, j)] = self.law.derivative[j * n + i] * h;
            }
        }
        if self.ramps {
            for j in 0..inputs {
                block[(n + j, n + inputs + j)] = h;
            }
        }
        let e = exp(&block);
        let columns = |from: usize, count: usize| {
            (from..from + count)
                .flat_map(|j| e.column(j).iter().take(n).copied().collect::<Vec<_>>())
                .collect()
        };
        Transition {
            h,
            phi: columns(0, n),
            held: columns(n, inputs),
            ramp: if self.ramps { columns(n + inputs, inputs) } else { Vec::new() },
        }
    }

    /// Computes the contribution of signals and the constant over a transition; constant signals contribute the same until one of them changes.
    fn force(&mut self, at: usize, from_s: f64, drive: &Drive) {
        let level = drive.pieces.iter().all(|piece| piece.slope == 0.0);
        if level
            && self.forced_by == Some(at)
            && self.levels.iter().zip(&drive.pieces).all(|(level, piece)| *level == piece.value)
        {
            return;
        }
        self.kept[at].force(&mut self.forced, from_s, drive);
        self.forced_by = level.then_some(at);
        for (level, piece) in self.levels.iter_mut().zip(&drive.pieces) {
            *level = piece.value;
        }
    }

    /// A length that occurs once: powers of two, each a cached step, and a short remainder.
    fn in_parts(&mut self, from_s: f64, h: f64, drive: &Drive) {
        let (mut at, mut rest) = (from_s, h);
        while self.law.norm * rest > SERIES_LIMIT {
            let part = rest.log2().floor().exp2();
            let number = self.powers.iter().position(|t| t.h == part).unwrap_or_else(|| {
                let transition = self.known(part);
                self.powers.push(transition);
                self.powers.len() - 1
            });
            let transition = Rc::clone(&self.powers[number]);
            transition.force(&mut self.forced, at, drive);
            transition.step(&self.forced, &mut self.x, &mut self.next);
            at += part;
            rest -= part;
        }
        self.forced_by = None;
        if rest > 0.0 {
            self.by_series(at, rest, drive);
        }
    }

    /// Taylor's series of exp(M h) applied to the state (Al-Mohy and Higham 2011, SIAM J. Sci. Comput. 33(2), 488-511, doi:10.1137/100788860). The
    /// derivative of the signals enters with the second term.
    fn by_series(&mut self, from_s: f64, h: f64, drive: &Drive) {
        let n = self.states;
        let [term, other] = &mut self.series;
        // M·(x; v; 1)·h
        multiply(term, &self.law.derivative[..n * n], &self.x, h);
        for (j, piece) in drive.pieces.iter().enumerate() {
            axpy(term, h * piece.at(from_s), &self.law.derivative[(n + j) * n..(n + j + 1) * n]);
        }
        axpy(term, h, &self.law.derivative[(n + self.signals) * n..]);
        let mut order = 1.0;
        loop {
            let (mut size, mut total) = (0.0_f64, f64::MIN_POSITIVE);
            for (x, term) in self.x.iter_mut().zip(term.iter()) {
                *x += term;
                size = size.max(term.abs());
                total = total.max(x.abs());
            }
            if order > 1.0 && size <= 1e-17 * total || order > 40.0 {
                break;
            }
            order += 1.0;
            multiply(other, &self.law.derivative[..n * n], term, h / order);
            if order == 2.0 {
                for (j, piece) in drive.pieces.iter().enumerate() {
                    axpy(
                        other,
                        0.5 * h * h * piece.slope,
                        &self.law.derivative[(n + j) * n..(n + j + 1) * n],
                    );
                }
            }
            std::mem::swap(term, other);
        }
    }
}

impl Transition {
    /// The contribution of signals and the constant.
    fn force(&self, forced: &mut [f64], from_s: f64, drive: &Drive) {
        let n = forced.len();
        let (signals, constant) = self.held.split_at(self.held.len() - n);
        forced.copy_from_slice(constant);
        for (column, piece) in signals.chunks_exact(n).zip(&drive.pieces) {
            axpy(forced, piece.at(from_s), column);
        }
        for (column, piece) in self.ramp.chunks_exact(n).zip(&drive.pieces) {
            axpy(forced, piece.slope, column);
        }
    }

    /// x ← forced + Φ x; `next` is overwritten.
    fn step(&self, forced: &[f64], x: &mut Vec<f64>, next: &mut Vec<f64>) {
        // A number of states known at compile time keeps them in registers.
        match x.len() {
            1 => step::<1>(&self.phi, forced, x),
            2 => step::<2>(&self.phi, forced, x),
            3 => step::<3>(&self.phi, forced, x),
            4 => step::<4>(&self.phi, forced, x),
            5 => step::<5>(&self.phi, forced, x),
            6 => step::<6>(&self.phi, forced, x),
            7 => step::<7>(&self.phi, forced, x),
            8 => step::<8>(&self.phi, forced, x),
            n => {
                next.copy_from_slice(forced);
                for (column, value) in self.phi.chunks_exact(n.max(1)).zip(x.iter()) {
                    axpy(next, *value, column);
                }
                std::mem::swap(x, next);
            }
        }
    }
}

/// x ← forced + Φ x, Φ by columns.
#[inline]
fn step<const N: usize>(phi: &[f64], forced: &[f64], x: &mut [f64]) {
    let (Some(x), Some(forced)) = (x.first_chunk_mut::<N>(), forced.first_chunk::<N>()) else {
        return;
    };
    let mut next = *forced;
    for (column, value) in phi.as_chunks::<N>().0.iter().zip(x.iter()) {
        for (to, entry) in next.iter_mut().zip(column) {
            *to += value * entry;
        }
    }
    *x = next;
}

/// to = scale·M·x, M by columns.
#[inline]
fn multiply(to: &mut [f64], by_columns: &[f64], x: &[f64], scale: f64) {
    to.fill(0.0);
    for (column, value) in by_columns.chunks_exact(to.len().max(1)).zip(x) {
        axpy(to, scale * value, column);
    }
}

#[inline]
fn axpy(to: &mut [f64], scale: f64, column: &[f64]) {
    for (to, value) in to.iter_mut().zip(column) {
        *to += scale * value;
    }
}

impl Stepper for Linear {
    fn advance(&mut self, from_s: f64, to_s: f64, drive: &Drive) -> Result<(), SimulateError> {
        let h = to_s - from_s;
        if self.states == 0 {
            return Ok(());
        }
        let Some(at) = self.transition(h) else {
            self.in_parts(from_s, h, drive);
            return Ok(());
        };
        self.force(at, from_s, drive);
        self.kept[at].step(&self.forced, &mut self.x, &mut self.next);
        Ok(())
    }

    fn outputs(&mut self, at_s: f64, drive: &Drive, y: &mut [f64]) -> Result<(), SimulateError> {
        let width = self.states + self.signals + 1;
        for (y, row) in y.iter_mut().zip(self.law.output.chunks_exact(width)) {
            let (of_states, of_signals) = row.split_at(self.states);
            let moved: f64 = of_states.iter().zip(&self.x).map(|(c, x)| c * x).sum();
            let direct: f64 = of_signals
                .iter()
                .zip(&drive.pieces)
                .map(|(d, piece)| if *d == 0.0 { 0.0 } else { d * piece.at(at_s) })
                .sum();
            *y = moved + direct + of_signals[self.signals];
        }
        Ok(())
    }

    fn switch(&mut self, number: usize) {
        if let Some(law) = self.later.get_mut(number) {
            std::mem::swap(&mut self.law, law);
            (self.kept, self.seen, self.powers, self.forced_by) =
                (Vec::new(), Vec::new(), Vec::new(), None);
        }
    }

    fn whole_state(&mut self) -> &mut [f64] {
        &mut self.x
    }

    fn plant_state(&mut self) -> &mut [f64] {
        &mut self.x[..self.plant]
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    use super::*;
    use crate::simulate::history::Histories;
    use crate::simulate::piecewise::Piece;

    /// A slow oscillation and a pole at −2000 per second, with one linear signal. Steps whose lengths never recur agree with one exponential each.
    #[test]
    fn steps_that_come_once_are_those_of_one_exponential_each() {
        let rows = vec![
            vec![0.0, 1.0, 0.0, 0.0, 0.1],
            vec![-4.0, -0.3, 2.0, 1.0, 0.0],
            vec![0.0, 0.0, -2000.0, 2000.0, 0.0],
        ];
        let assembly = Assembly {
            plant: 3,
            states: 3,
            signals: 1,
            inputs: Vec::new(),
            own: 0,
            outputs: Vec::new(),
            derivatives: rows.clone(),
            start: vec![0.2, -0.1, 0.5],
            memories: Vec::new(),
            raw: Vec::new(),
            late: Histories::default(),
        };
        let mut system = Linear::new(&assembly, &[], true);
        let piece = Piece { start_s: 0.0, value: 0.3, slope: -0.7 };
        let drive = Drive { pieces: vec![piece], alone_until_s: None, late: Histories::default() };
        // States, signal, its slope, 1.
        let mut block = DMatrix::zeros(6, 6);
        for (i, row) in rows.iter().enumerate() {
            for (to, from) in [0, 1, 2, 3, 5].into_iter().zip(row) {
                block[(i, to)] = *from;
            }
        }
        block[(3, 4)] = 1.0;
        let mut expected = DVector::from_vec(vec![0.2, -0.1, 0.5, 0.3, -0.7, 1.0]);
        let (mut rng, mut now) = (ChaCha8Rng::seed_from_u64(5), 0.0);
        for _ in 0..300 {
            let h = rng.random_range(1e-6..0.03);
            system.advance(now, now + h, &drive).unwrap();
            expected = (&block * ((now + h) - now)).exp() * expected;
            now += h;
            for (x, e) in system.state().iter().zip(expected.iter()) {
                assert!((x - e).abs() < 1e-11, "{:?} at {now} s is not {expected}", system.state());
            }
        }
        assert!(system.kept.is_empty() && system.powers.len() < 20);
    }
}
