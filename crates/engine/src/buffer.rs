//! Memory aligned to cache lines, and a pool that keeps it between operations.
//!
//! Fresh memory costs a page fault per 4 KiB; a forward pass would take gigabytes of it. The pool
//! hands the same few buffers out again and again.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, PoisonError};

/// Values in a cache line.
const LINE: usize = 16;

#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Line([f32; LINE]);

/// Numbers that begin at a cache line.
#[derive(Default)]
pub(crate) struct Buffer {
    lines: Vec<Line>,
    len: usize,
}

impl Buffer {
    /// `len` zeros.
    pub(crate) fn zeroed(len: usize) -> Self {
        Self { lines: vec![Line([0.0; LINE]); padded(len) / LINE], len }
    }

    /// Changes the length and keeps the memory where it is large enough; values are arbitrary afterwards.
    pub(crate) fn set_len(&mut self, len: usize) {
        let lines = padded(len) / LINE;
        if lines > self.lines.len() {
            // Nothing of the old content is wanted: a new allocation saves its copy.
            self.lines = Vec::new();
            self.lines = vec![Line([0.0; LINE]); lines];
        }
        self.len = len;
    }

    fn capacity(&self) -> usize {
        self.lines.len() * LINE
    }
}

impl Deref for Buffer {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        // SAFETY: `lines` holds at least `len` initialised f32 without gaps (size of `Line` = 16 f32, repr C).
        unsafe { std::slice::from_raw_parts(self.lines.as_ptr().cast(), self.len) }
    }
}

impl DerefMut for Buffer {
    fn deref_mut(&mut self) -> &mut [f32] {
        // SAFETY: as in `deref`; the borrow of `self` is exclusive.
        unsafe { std::slice::from_raw_parts_mut(self.lines.as_mut_ptr().cast(), self.len) }
    }
}

/// Values that a buffer of `len` values has room for.
pub(crate) fn padded(len: usize) -> usize {
    len.next_multiple_of(LINE)
}

/// Which of the buffers at rest is lent for `len` values, by their capacities; `None`: a new one.
pub(crate) fn choose(capacities: impl Iterator<Item = usize> + Clone, len: usize) -> Option<usize> {
    let fitting = capacities.clone().enumerate().filter(|(_, capacity)| *capacity >= len);
    match fitting.min_by_key(|(_, capacity)| *capacity) {
        // A buffer far too large is left for the operation that needs it.
        Some((idx, capacity)) => (capacity <= 4 * len + 4096).then_some(idx),
        // None is large enough: the largest gives its memory back before a larger one is made.
        None => {
            let largest = capacities.enumerate().max_by_key(|(_, capacity)| *capacity);
            largest.filter(|(_, capacity)| 2 * capacity >= len).map(|(idx, _)| idx)
        }
    }
}

/// Buffers at rest.
#[derive(Default)]
pub(crate) struct Pool {
    resting: Mutex<Vec<Buffer>>,
}

impl Pool {
    /// A buffer of `len` arbitrary values, returned to the pool when dropped.
    pub(crate) fn take(&self, len: usize) -> Loan<'_> {
        let mut resting = self.resting.lock().unwrap_or_else(PoisonError::into_inner);
        let taken = choose(resting.iter().map(Buffer::capacity), len).map(|idx| resting.swap_remove(idx));
        drop(resting);
        let mut buffer = taken.unwrap_or_default();
        buffer.set_len(len);
        Loan { buffer, pool: self }
    }

    /// Frees the memory at rest.
    pub(crate) fn clear(&self) {
        self.resting.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }
}

/// A buffer on loan from a [`Pool`].
pub(crate) struct Loan<'a> {
    buffer: Buffer,
    pool: &'a Pool,
}

impl Deref for Loan<'_> {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.buffer
    }
}

impl DerefMut for Loan<'_> {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.buffer
    }
}

impl Drop for Loan<'_> {
    fn drop(&mut self) {
        let buffer = std::mem::take(&mut self.buffer);
        self.pool.resting.lock().unwrap_or_else(PoisonError::into_inner).push(buffer);
    }
}

thread_local! {
    static SCRATCH: std::cell::RefCell<Vec<Buffer>> = const { std::cell::RefCell::new(Vec::new()) };
}

/// Lends the calling thread's own scratch memory (arbitrary values) to `work`; calls may be nested.
pub(crate) fn with_scratch<R>(len: usize, work: impl FnOnce(&mut [f32]) -> R) -> R {
    let mut buffer = SCRATCH.with_borrow_mut(Vec::pop).unwrap_or_default();
    buffer.set_len(len);
    let result = work(&mut buffer);
    SCRATCH.with_borrow_mut(|stack| stack.push(buffer));
    result
}

/// A shared output, of which each task writes a part of its own.
#[derive(Clone, Copy)]
pub(crate) struct SharedOut {
    start: *mut f32,
    len: usize,
}

// SAFETY: a `SharedOut` only says where the memory is; every write goes through `row`, whose caller
// promises that no other task touches the same values.
unsafe impl Send for SharedOut {}
// SAFETY: as above.
unsafe impl Sync for SharedOut {}

impl SharedOut {
    /// Over the values of `out`, which stay borrowed by the caller while tasks write.
    pub(crate) fn new(out: &mut [f32]) -> Self {
        Self { start: out.as_mut_ptr(), len: out.len() }
    }

    /// `len` values from `first` on.
    ///
    /// # Safety
    /// The memory lives, and no other reference to these values exists while the result is used.
    pub(crate) unsafe fn row<'a>(self, first: usize, len: usize) -> &'a mut [f32] {
        assert!(first + len <= self.len, "a task writes outside its output");
        // SAFETY: inside the allocation (asserted); exclusive by the caller's promise.
        unsafe { std::slice::from_raw_parts_mut(self.start.add(first), len) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_are_aligned_and_come_back() {
        let pool = Pool::default();
        let first = {
            let loan = pool.take(1000);
            assert_eq!(loan.len(), 1000);
            assert_eq!(loan.as_ptr() as usize % 64, 0);
            loan.as_ptr()
        };
        assert_eq!(pool.take(990).as_ptr(), first, "the same memory again");
        pool.clear();
        assert!(pool.resting.lock().unwrap().is_empty());
    }

    #[test]
    fn scratch_may_be_nested() {
        with_scratch(10, |outer| {
            outer.fill(1.0);
            with_scratch(10, |inner| inner.fill(2.0));
            assert!(outer.iter().all(|v| *v == 1.0));
        });
    }
}
