//! Long work that answers Ctrl-C, reports progress, and runs on the asked number of threads.

use crate::control::Control;
use crate::error::Error;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// How often the waiting thread looks for Ctrl-C and reports progress.
const POLL: Duration = Duration::from_millis(50);

/// More threads than any machine has use for; starting them alone would take minutes.
const MOST_THREADS: i64 = 1024;

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
    let pool = match threads {
        None => None,
        Some(n) if !(1..=MOST_THREADS).contains(&n) => {
            return Err(PyValueError::new_err(format!("threads must be 1 to {MOST_THREADS}, got {n}")));
        }
        Some(n) => Some(
            rayon::ThreadPoolBuilder::new()
                .num_threads(n as usize)
                .build()
                .map_err(|e| PyRuntimeError::new_err(e.to_string()))?,
        ),
    };
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
            (None, Err(_)) => {
                Err(PyRuntimeError::new_err("a kernel broke one of its own promises; please report it"))
            }
        }
    })
}
