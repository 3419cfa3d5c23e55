//! Long work that answers Ctrl-C, reports progress, and runs on the asked number of threads.

use crate::control::Control;
use crate::error::Error;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use rayon::ThreadPool;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How often the waiting thread looks for Ctrl-C and reports progress.
const POLL: Duration = Duration::from_millis(50);

/// More threads than any machine has use for; starting them alone would take minutes.
const MOST_THREADS: i64 = 1024;

const BROKEN_PROMISE: &str = "a kernel broke one of its own promises; please report it";

/// Runs `work` without the GIL on `threads` threads (all cores if `None`).
///
/// `progress`, if given, is called with the units of work done so far; what it raises stops the work.
///
/// # Errors
/// What `work` returns; `KeyboardInterrupt` or what `progress` raised; `RuntimeError` if `work` panicked.
pub fn run<T: Send>(
    py: Python<'_>,
    threads: Option<i64>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Control) -> Result<T, Error> + Send,
) -> PyResult<T> {
    let pool = threads.map(pool).transpose()?;
    let control = Control::default();
    let (sender, mut receiver) = channel();
    std::thread::scope(|scope| {
        let control = &control;
        let worker = scope.spawn(move || {
            let result = match pool {
                Some(pool) => pool.install(|| work(control)),
                None => work(control),
            };
            // The receiver is gone only if the waiting thread is unwinding already.
            let _ = sender.send(());
            result
        });
        let mut raised = None;
        loop {
            let receiver = &mut receiver;
            let waited = py.detach(move || receiver.recv_timeout(POLL));
            if raised.is_none() {
                let report = progress.map_or(Ok(()), |p| p.call1((control.done(),)).map(drop));
                if let Err(error) = py.check_signals().and(report) {
                    control.stop();
                    raised = Some(error);
                }
            }
            match waited {
                Err(RecvTimeoutError::Timeout) => {}
                Ok(()) | Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        let result = py.detach(|| worker.join());
        match (raised, result) {
            (Some(error), _) => Err(error),
            (None, Ok(result)) => Ok(result?),
            (None, Err(_)) => Err(PyRuntimeError::new_err(BROKEN_PROMISE)),
        }
    })
}

/// Runs work of some milliseconds without the GIL on `threads` threads (all cores if `None`).
///
/// Starts nothing new: pools are kept from call to call. Ctrl-C is answered once the work is done.
///
/// # Errors
/// What `work` returns; `KeyboardInterrupt`; `RuntimeError` if `work` panicked.
pub fn brief<T: Send>(
    py: Python<'_>,
    threads: Option<i64>,
    work: impl FnOnce(&Control) -> Result<T, Error> + Send,
) -> PyResult<T> {
    let pool = threads.map(kept_pool).transpose()?;
    let result = py.detach(|| {
        catch_unwind(AssertUnwindSafe(|| {
            let control = Control::default();
            match pool {
                Some(pool) => pool.install(|| work(&control)),
                None => work(&control),
            }
        }))
    });
    py.check_signals()?;
    match result {
        Ok(result) => Ok(result?),
        Err(_) => Err(PyRuntimeError::new_err(BROKEN_PROMISE)),
    }
}

/// A pool of its own.
fn pool(threads: i64) -> PyResult<ThreadPool> {
    if !(1..=MOST_THREADS).contains(&threads) {
        return Err(PyValueError::new_err(format!("threads must be 1 to {MOST_THREADS}, got {threads}")));
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads as usize)
        .build()
        .map_err(|e| PyRuntimeError::new_err(e.to_string()))
}

/// The pool of so many threads that was made before, if there was one.
fn kept_pool(threads: i64) -> PyResult<Arc<ThreadPool>> {
    static POOLS: Mutex<BTreeMap<i64, Arc<ThreadPool>>> = Mutex::new(BTreeMap::new());
    let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(pool) = pools.get(&threads) {
        return Ok(pool.clone());
    }
    let pool = Arc::new(self::pool(threads)?);
    pools.insert(threads, pool.clone());
    Ok(pool)
}
