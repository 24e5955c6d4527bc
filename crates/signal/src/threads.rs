//! The allowed number of threads.

/// Threads for each core at most: more only wait for each other, and some tens of thousands are not even made.
const EACH: usize = 4;

/// The requested number of threads, up to four for each core; 0 stays 0.
#[must_use]
pub fn at_most(asked: usize) -> usize {
    asked.min(EACH * std::thread::available_parallelism().map_or(1, usize::from))
}

#[cfg(test)]
mod tests {
    use super::at_most;

    #[test]
    fn few_threads_are_as_asked_and_many_are_not() {
        assert_eq!([0, 1, 4].map(at_most), [0, 1, 4]);
        let cores = std::thread::available_parallelism().unwrap().get();
        assert_eq!([20_000, usize::MAX].map(at_most), [4 * cores; 2]);
    }
}
