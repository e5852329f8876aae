//! What the footprint says beside what the engine really allocates.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and says what it found"
)]

use std::alloc::{GlobalAlloc, Layout as Block, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use selenograph_engine::{Engine, Image, MemoryFootprint};
use selenograph_network::cost::Directions;
use selenograph_network::layout::Layout;
use selenograph_network::{NetworkConfig, Preset};

/// Names, lists and the thread pool's own memory are left out; scratch memory for sums of several parts, which small
/// networks do not need, is in.
const MARGIN_BYTES: usize = 200_000;

static HELD: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

struct Counting;

// SAFETY: every call goes to the system's allocator; the counters allocate nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, block: Block) -> *mut u8 {
        PEAK.fetch_max(HELD.fetch_add(block.size(), Relaxed) + block.size(), Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(block) }
    }

    unsafe fn dealloc(&self, start: *mut u8, block: Block) {
        HELD.fetch_sub(block.size(), Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(start, block) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// Bytes held after `work`, and the most that was held meanwhile, both beyond what was held before.
fn measured<T>(work: impl FnOnce() -> T) -> (T, usize, usize) {
    let before = HELD.load(Relaxed);
    PEAK.store(before, Relaxed);
    let result = work();
    (result, HELD.load(Relaxed) - before, PEAK.load(Relaxed) - before)
}

/// On threads of its own, whose scratch memory is gone afterwards.
fn on_two_threads<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    let mut handles = Vec::new();
    let spawn = |thread: rayon::ThreadBuilder| {
        handles.push(std::thread::spawn(|| thread.run()));
        Ok(())
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).spawn_handler(spawn).build().unwrap();
    let result = pool.install(work);
    drop(pool);
    handles.into_iter().for_each(|handle| handle.join().unwrap());
    result
}

fn check(what: &str, stated: usize, found: usize) {
    println!("{what}: {stated} bytes stated, {found} allocated");
    assert!(stated.abs_diff(found) <= MARGIN_BYTES, "{what}: {stated} bytes stated, {found} allocated");
}

fn zeros(config: &NetworkConfig) -> Engine {
    let layout = Layout::new(config).unwrap();
    Engine::new(config, &mut |name| {
        let spec = layout.get(name).ok_or("no such tensor")?;
        Ok((spec.shape.clone(), vec![0.0; spec.len()]))
    })
    .unwrap()
}

/// One test: the counters are the process's.
#[test]
fn the_footprint_is_what_the_engine_allocates() {
    let (square, wide, tall) = ([128, 128], [160, 96], [80, 208]);
    for (preset, inputs) in [
        (Preset::Tiny, [[square, square], [wide, tall]]),
        (Preset::Small, [[[256, 192], [256, 192]], [wide, tall]]),
        (Preset::Hybrid, [[[256, 192], [256, 192]], [wide, tall]]),
    ] {
        let config = preset.config();
        let (engine, held, peak) = on_two_threads(|| measured(|| zeros(&config)));
        for sizes in inputs {
            for directions in [Directions::Forward, Directions::Both] {
                let stated = MemoryFootprint::of_pair(&config, sizes, directions, 2).unwrap();
                check("weights", stated.weights, held);
                // A bound: the largest tensor is not the last one that is read.
                let loading = stated.weights + stated.loading;
                assert!(peak < loading + MARGIN_BYTES && peak > stated.weights, "loading {loading}, {peak}");
                let name = format!("{} {sizes:?} {directions:?}", preset.name());
                check(&name, stated.running, running(&engine, sizes, directions));
            }
        }
    }
}

/// The most that a pair takes beside the weights.
fn running(engine: &Engine, sizes: [[usize; 2]; 2], directions: Directions) -> usize {
    let pictures = sizes.map(|[width, height]| vec![0.0; 3 * width * height]);
    let [a, b] =
        [0, 1].map(|idx| Image { height_px: sizes[idx][1], width_px: sizes[idx][0], values: &pictures[idx] });
    let infer = || match directions {
        Directions::Forward => vec![engine.infer(a, b).unwrap()],
        Directions::Both => engine.infer_symmetric(a, b).unwrap().into(),
    };
    let (_, _, peak) = on_two_threads(|| measured(infer));
    engine.release_buffers();
    peak
}
