//! How much memory there is: the machine's, or what its control group leaves this process.

use std::fs;
use std::path::Path;

/// Bytes; `None` where nothing says it.
pub fn memory_bytes() -> Option<u64> {
    let group = fs::read_to_string("/proc/self/cgroup").ok();
    let limits = group.as_deref().map_or(Vec::new(), |group| limits(group, Path::new("/sys/fs/cgroup")));
    let machine = fs::read_to_string("/proc/meminfo").ok().and_then(|text| total(&text));
    limits.into_iter().chain(machine).min()
}

/// `MemTotal` of `/proc/meminfo`, which writes kB and means 1024 bytes.
fn total(meminfo: &str) -> Option<u64> {
    let rest = meminfo.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    rest.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// `memory.max` of the process's group and of those above it (cgroup v2), as far as they are numbers.
fn limits(group: &str, root: &Path) -> Vec<u64> {
    let Some(own) = group.lines().find_map(|line| line.strip_prefix("0::/")) else { return Vec::new() };
    let folder = root.join(own);
    let above = folder.ancestors().take_while(|folder| folder.starts_with(root));
    above.filter_map(|folder| fs::read_to_string(folder.join("memory.max")).ok()?.trim().parse().ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_says_how_much_there_is() {
        // proc(5) and the kernel's cgroup-v2.rst: the lines as they are written there.
        assert_eq!(total("MemTotal:       16384 kB\nMemFree:         1 kB\n"), Some(16 << 20));
        assert_eq!(total("MemFree: 1 kB\n"), None);
        let root = tempfile::tempdir().unwrap();
        let own = root.path().join("machine/lampwright.service");
        fs::create_dir_all(&own).unwrap();
        fs::write(own.join("memory.max"), "max\n").unwrap();
        fs::write(root.path().join("machine/memory.max"), "1073741824\n").unwrap();
        assert_eq!(limits("0::/machine/lampwright.service\n", root.path()), [1 << 30]);
        assert_eq!(limits("0::/\n", root.path()), [0; 0]);
        assert_eq!(limits("4:memory:/v1\n", root.path()), [0; 0]);
    }

    #[test]
    fn this_machine_has_some() {
        let free = std::process::Command::new("free").arg("-b").output().unwrap();
        let text = String::from_utf8(free.stdout).unwrap();
        let machine: u64 = text.lines().nth(1).unwrap().split_whitespace().nth(1).unwrap().parse().unwrap();
        assert!(memory_bytes().is_some_and(|bytes| bytes > 0 && bytes <= machine), "{:?}", memory_bytes());
    }
}
