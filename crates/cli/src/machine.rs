//! What this machine has: memory, disk, and how fast it multiplies.

use crate::commands::clock::instant;
use selenograph_engine::GemmBenchmark;
use serde::Serialize;
use std::path::Path;
use std::time::Duration;

/// How long multiplying is timed, once it is warm.
const TIMED: Duration = Duration::from_millis(250);
/// Fewest products that are timed.
const MIN_PRODUCTS: usize = 3;

/// Memory of this machine, or of the container that this program runs in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Memory {
    /// All of it.
    pub total_bytes: u64,
    /// What programs can still take without swapping.
    pub free_bytes: u64,
}

impl Memory {
    /// As it is now; `None` where the system does not tell.
    pub fn now() -> Option<Self> {
        let text = |path: &str| std::fs::read_to_string(path).ok();
        let machine = of_meminfo(&text("/proc/meminfo")?)?;
        let group = |name: &str| text(&format!("/sys/fs/cgroup/memory.{name}"));
        let limit = of_group(
            &group("max").unwrap_or_default(),
            &group("current").unwrap_or_default(),
            &group("stat").unwrap_or_default(),
        );
        Some(limit.map_or(machine, |limit| Self {
            total_bytes: machine.total_bytes.min(limit.total_bytes),
            free_bytes: machine.free_bytes.min(limit.free_bytes),
        }))
    }
}

/// From Linux's table of kibibytes.
fn of_meminfo(text: &str) -> Option<Memory> {
    let entry = |name: &str| Some(1024 * number_after(text, name)?);
    Some(Memory { total_bytes: entry("MemTotal:")?, free_bytes: entry("MemAvailable:")? })
}

/// From a control group's files; `None` where it has no limit.
fn of_group(max: &str, current: &str, stat: &str) -> Option<Memory> {
    let total_bytes: u64 = max.trim().parse().ok()?;
    let used: u64 = current.trim().parse().ok()?;
    // Files that were read long ago give way.
    let idle = number_after(stat, "inactive_file").unwrap_or(0);
    Some(Memory { total_bytes, free_bytes: total_bytes.saturating_sub(used.saturating_sub(idle)) })
}

fn number_after(text: &str, name: &str) -> Option<u64> {
    let mut words = text.lines().find_map(|line| line.strip_prefix(name))?.split_whitespace();
    words.next()?.parse().ok()
}

/// Bytes that can still be written to a folder; `None` where the system does not tell.
#[cfg(unix)]
pub fn disk_free(folder: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(folder).ok()?;
    disk.f_bavail.checked_mul(disk.f_frsize)
}

/// Bytes that can still be written to a folder: this system does not tell.
#[cfg(not(unix))]
pub fn disk_free(_folder: &Path) -> Option<u64> {
    None
}

/// Floating-point operations per second in products of large matrices, with all threads, measured now in a fraction of a second.
pub fn product_rate() -> f64 {
    let mut product = GemmBenchmark::new(768, 1024, 2048);
    // The first touches all memory and wakes the threads.
    product.run();
    let start = instant();
    let mut fastest = Duration::MAX;
    let mut num_products = 0;
    while num_products < MIN_PRODUCTS || start.elapsed() < TIMED {
        let one = instant();
        product.run();
        fastest = fastest.min(one.elapsed());
        num_products += 1;
    }
    product.num_flops() / fastest.as_secs_f64()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_read_from_the_systems_tables() {
        let meminfo = "MemTotal:       100 kB\nMemFree:         10 kB\nMemAvailable:    60 kB\n";
        assert_eq!(of_meminfo(meminfo), Some(Memory { total_bytes: 102_400, free_bytes: 61_440 }));
        assert_eq!(of_meminfo("MemTotal: 100 kB"), None);
        let stat = "anon 300\ninactive_file 200\n";
        assert_eq!(of_group("1000\n", "700\n", stat), Some(Memory { total_bytes: 1000, free_bytes: 500 }));
        assert_eq!(of_group("1000", "1200", ""), Some(Memory { total_bytes: 1000, free_bytes: 0 }));
        assert_eq!(of_group("max\n", "700\n", stat), None);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn this_machine_has_memory_and_disk() {
        let memory = Memory::now().unwrap();
        assert!(memory.free_bytes > 0 && memory.free_bytes <= memory.total_bytes);
        assert!(disk_free(Path::new(".")).is_some());
        assert!(product_rate() > 0.0);
    }
}
