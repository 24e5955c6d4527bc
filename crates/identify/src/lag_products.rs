//! Sums of products of two signals at many lags: every sample is read once per block and multiplied in registers.

use deadtime_signal::parallel;
use nalgebra::DMatrix;
use pulp::{Arch, Simd, WithSimd};

/// Samples of a block: two signals of it stay in the first-level cache.
const BLOCK: usize = 2048;
/// Samples per partial sum; the fixed number makes the result independent of the number of threads.
const CHUNK: usize = 1 << 17;

/// Σ a(t)·b(t − lag) for lag = from … from + count − 1.
#[derive(Clone, Copy)]
struct Lags<'a> {
    a: &'a [f64],
    b: &'a [f64],
    from: usize,
    count: usize,
}

/// The concatenated sums of every task over t = first … end − 1; no lag is beyond `first`.
fn sums(tasks: &[Lags], first: usize, end: usize) -> Vec<f64> {
    let total = tasks.iter().map(|t| t.count).sum();
    let arch = Arch::new();
    let part = |start: usize| {
        let mut sums = vec![0.0; total];
        arch.dispatch(Chunk { tasks, start, end: (start + CHUNK).min(end), sums: &mut sums });
        sums
    };
    if end <= first + CHUNK {
        return part(first);
    }
    let starts: Vec<usize> = (first..end).step_by(CHUNK).collect();
    let parts: Vec<Vec<f64>> = parallel::map(starts, part);
    let mut sum = vec![0.0; total];
    for part in parts {
        for (s, p) in sum.iter_mut().zip(part) {
            *s += p;
        }
    }
    sum
}

struct Chunk<'a> {
    tasks: &'a [Lags<'a>],
    start: usize,
    end: usize,
    sums: &'a mut [f64],
}

impl WithSimd for Chunk<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let lanes = S::F64_LANES;
        // The first rows one product at a time, until a whole vector of lags fits.
        let longest =
            self.tasks.iter().map(|t| t.from + t.count.next_multiple_of(lanes)).max().unwrap_or(0);
        let head = longest.clamp(self.start, self.end);
        self.each(self.start, head);
        let whole = head + (self.end - head) / lanes * lanes;
        for start in (head..whole).step_by(BLOCK) {
            let stop = (start + BLOCK).min(whole);
            let mut at = 0;
            for task in self.tasks {
                block(simd, task, start, stop, &mut self.sums[at..at + task.count]);
                at += task.count;
            }
        }
        self.each(whole, self.end);
    }
}

impl Chunk<'_> {
    #[inline(always)]
    fn each(&mut self, start: usize, stop: usize) {
        let mut at = 0;
        for task in self.tasks.iter().filter(|task| task.count > 0) {
            for t in start..stop {
                let a = task.a[t];
                let newest = t - task.from;
                let past = &task.b[newest + 1 - task.count..=newest];
                for (sum, b) in self.sums[at..at + task.count].iter_mut().zip(past.iter().rev()) {
                    *sum += a * b;
                }
            }
            at += task.count;
        }
    }
}

/// All lags of one block, in as many vectors of lags at a time as the registers hold.
#[inline(always)]
fn block<S: Simd>(simd: S, task: &Lags, start: usize, stop: usize, sums: &mut [f64]) {
    let lanes = S::F64_LANES;
    let mut groups = sums.len().div_ceil(lanes);
    let most = if lanes == 8 { 5 } else { 2 };
    let mut from = 0;
    while groups > 0 {
        let now = groups.div_ceil(groups.div_ceil(most));
        let to = (from + now * lanes).min(sums.len());
        let sums = &mut sums[from..to];
        let lag = task.from + from;
        match now {
            1 => tiles::<S, 1>(simd, task, start, stop, lag, sums),
            2 => tiles::<S, 2>(simd, task, start, stop, lag, sums),
            3 => tiles::<S, 3>(simd, task, start, stop, lag, sums),
            4 => tiles::<S, 4>(simd, task, start, stop, lag, sums),
            _ => tiles::<S, 5>(simd, task, start, stop, lag, sums),
        }
        groups -= now;
        from = to;
    }
}

#[inline(always)]
fn tiles<S: Simd, const P: usize>(
    simd: S,
    task: &Lags,
    start: usize,
    stop: usize,
    lag: usize,
    sums: &mut [f64],
) {
    if S::F64_LANES.is_multiple_of(4) {
        for shift in (0..S::F64_LANES).step_by(4) {
            tile::<S, P, 4>(simd, task, start, stop, lag, shift, sums);
        }
    } else {
        for shift in 0..S::F64_LANES {
            tile::<S, P, 1>(simd, task, start, stop, lag, shift, sums);
        }
    }
}

/// Lags lag + shift + r + lanes·p, r < R, p < P. Each vector of b, shifted by r, is multiplied with the P vectors of a at these lags.
#[inline(always)]
fn tile<S: Simd, const P: usize, const R: usize>(
    simd: S,
    task: &Lags,
    start: usize,
    stop: usize,
    lag: usize,
    shift: usize,
    sums: &mut [f64],
) {
    let lanes = S::F64_LANES;
    let back = lag + shift + lanes * (P - 1);
    let (a, _) = S::as_simd_f64s(&task.a[start..stop]);
    let length = stop - start + lanes * (P - 1);
    let b: [&[S::f64s]; R] = std::array::from_fn(|r| {
        S::as_simd_f64s(&task.b[start - back - r..start - back - r + length]).0
    });
    let mut acc = [[simd.splat_f64s(0.0); P]; R];
    // b[q] is multiplied with a[q + p + 1 − P]: all P of them inside the block, or those that are.
    let edge = |acc: &mut [[S::f64s; P]; R], q: usize| {
        for (row, right) in acc.iter_mut().zip(&b) {
            for (p, sum) in row.iter_mut().enumerate() {
                if let Some(&left) = (q + p + 1).checked_sub(P).and_then(|m| a.get(m)) {
                    *sum = simd.mul_add_e_f64s(left, right[q], *sum);
                }
            }
        }
    };
    for q in 0..(P - 1).min(a.len()) {
        edge(&mut acc, q);
    }
    if a.len() >= P {
        let inner = a.len() + 1 - P;
        let right: [&[S::f64s]; R] = std::array::from_fn(|r| &b[r][P - 1..P - 1 + inner]);
        for (i, left) in a.windows(P).enumerate() {
            let right: [S::f64s; R] = std::array::from_fn(|r| right[r][i]);
            for p in 0..P {
                for r in 0..R {
                    acc[r][p] = simd.mul_add_e_f64s(left[p], right[r], acc[r][p]);
                }
            }
        }
    }
    for q in a.len().max(P - 1)..a.len() + P - 1 {
        edge(&mut acc, q);
    }
    for (r, row) in acc.iter().enumerate() {
        for (p, &value) in row.iter().enumerate() {
            if let Some(sum) = sums.get_mut(shift + r + lanes * p) {
                *sum += simd.reduce_sum_f64s(value);
            }
        }
    }
}

/// Σ over t = first … of a(t − i)·b(t − j), i and j below the two `lags`; without b, of a with itself.
pub fn lag_matrix(
    a: &[f64],
    b: Option<&[f64]>,
    first: usize,
    lags: (usize, usize),
) -> DMatrix<f64> {
    let end = a.len();
    if lags.0 == 0 || lags.1 == 0 || end <= first {
        return DMatrix::zeros(lags.0, lags.1);
    }
    let row = Lags { a, b: b.unwrap_or(a), from: 0, count: lags.1 };
    match b {
        None => {
            let sums = sums(&[row], first, end);
            fill(a, a, first, lags, &sums, &sums[1..])
        }
        Some(b) => {
            let sums = sums(&[row, Lags { a: b, b: a, from: 1, count: lags.0 - 1 }], first, end);
            fill(a, b, first, lags, &sums[..lags.1], &sums[lags.1..])
        }
    }
}

/// Σ a(t)·b(t − lag), lag = 0 … lags − 1, with signals zero before t = 0.
pub fn lag_vector(a: &[f64], b: &[f64], lags: usize) -> Vec<f64> {
    let padded = |x: &[f64]| [&vec![0.0; lags], x].concat();
    let (a, b) = (padded(a), padded(b));
    sums(&[Lags { a: &a, b: &b, from: 0, count: lags }], lags, a.len())
}

/// The lag matrices of a with itself, of a with b and of b with itself, in one pass over the signals.
pub(super) fn lag_matrices(
    a: &[f64],
    b: &[f64],
    first: usize,
    lags: (usize, usize),
) -> [DMatrix<f64>; 3] {
    let end = a.len();
    if lags.0 == 0 || lags.1 == 0 || end <= first {
        let square = |n| lag_matrix(if n == lags.0 { a } else { b }, None, first, (n, n));
        return [square(lags.0), DMatrix::zeros(lags.0, lags.1), square(lags.1)];
    }
    let tasks = [
        Lags { a, b: a, from: 0, count: lags.0 },
        Lags { a, b, from: 0, count: lags.1 },
        Lags { a: b, b: a, from: 1, count: lags.0 - 1 },
        Lags { a: b, b, from: 0, count: lags.1 },
    ];
    let sums = sums(&tasks, first, end);
    let (aa, rest) = sums.split_at(lags.0);
    let (ab, rest) = rest.split_at(lags.1);
    let (ba, bb) = rest.split_at(lags.0 - 1);
    [
        fill(a, a, first, (lags.0, lags.0), aa, &aa[1..]),
        fill(a, b, first, lags, ab, ba),
        fill(b, b, first, (lags.1, lags.1), bb, &bb[1..]),
    ]
}

/// The products with one lag 0 are given. Every other follows from its neighbour one sample earlier by corrections at the two ends.
fn fill(
    a: &[f64],
    b: &[f64],
    first: usize,
    lags: (usize, usize),
    row: &[f64],
    column: &[f64],
) -> DMatrix<f64> {
    let end = a.len();
    let mut products = DMatrix::zeros(lags.0, lags.1);
    for (j, &value) in row.iter().enumerate() {
        products[(0, j)] = value;
    }
    for (i, &value) in column.iter().enumerate() {
        products[(i + 1, 0)] = value;
    }
    for j in 1..lags.1 {
        for i in 1..lags.0 {
            products[(i, j)] =
                products[(i - 1, j - 1)] + a[first - i] * b[first - j] - a[end - i] * b[end - j];
        }
    }
    products
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Long enough for several chunks: the sums equal the direct ones, and one thread gives the same bits as several.
    #[test]
    fn lag_sums_do_not_depend_on_the_number_of_threads() {
        let signal = |step: usize| -> Vec<f64> {
            (0..2 * CHUNK + 777).map(|k| ((k * step) % 1009) as f64 / 500.0 - 1.0).collect()
        };
        let (a, b) = (signal(7919), signal(104_729));
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| lag_matrices(&a, &b, 40, (11, 41)))
        };
        let one = run(1);
        assert_eq!(one, run(3));
        for (i, j) in [(0, 0), (0, 40), (10, 0), (7, 23)] {
            let direct: f64 = (40..a.len()).map(|t| a[t - i] * b[t - j]).sum();
            assert!((one[1][(i, j)] - direct).abs() < 1e-9 * a.len() as f64, "{i} {j}");
        }
    }

    #[test]
    fn lag_vectors_see_zeros_before_the_signal() {
        let (a, b) = ([1.0, 2.0, 3.0], [1.0, 10.0, 100.0]);
        assert_eq!(lag_vector(&a, &b, 4), [321.0, 32.0, 3.0, 0.0]);
    }
}
