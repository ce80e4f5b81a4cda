//! Damage that is the same in every run.

/// Marsaglia's xorshift.
pub struct Dice(pub u64);

impl Dice {
    pub fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % n.max(1) as u64) as usize
    }

    /// One flip, cut, stretch of zeros or repetition.
    pub fn damage(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut out = bytes.to_vec();
        if out.is_empty() {
            return vec![0; self.below(9)];
        }
        let (at, length) = (self.below(out.len()), 1 + self.below(16));
        let end = (at + length).min(out.len());
        match self.below(5) {
            0 => out[at] ^= 1 << self.below(8),
            1 => out.truncate(at),
            2 => out[at..end].fill(0),
            3 => out[at..end].fill(0xff),
            _ => {
                let again = out[at..end].to_vec();
                out.splice(at..at, again);
            }
        }
        out
    }
}

/// How many times the usual damage is done: UNWATER_FUZZ=100 for a long run.
pub fn factor() -> usize {
    std::env::var("UNWATER_FUZZ").ok().and_then(|f| f.parse().ok()).unwrap_or(1)
}

/// Runs `body` in a process of its own, which is this binary with one test, `module::name`, and
/// fails if that process ever had more than 1 GiB in memory (where the system reports it).
pub fn with_bounded_memory(test: &str, body: impl FnOnce()) {
    const ALONE: &str = "UNWATER_TEST_ALONE";
    if std::env::var_os(ALONE).is_some() {
        body();
        return ensure_memory_is_bounded();
    }
    let program = std::env::current_exe().expect("the test binary");
    let ran = std::process::Command::new(program)
        .args(["--exact", test, "--nocapture"])
        .env(ALONE, "1")
        .output()
        .expect("the test binary runs");
    let printed = String::from_utf8_lossy(&ran.stdout);
    let errors = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success(), "{printed}{errors}");
    assert!(printed.contains("1 passed"), "no test of the name {test}: {printed}");
}

/// The largest resident size that this process has had.
fn ensure_memory_is_bounded() {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else { return };
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap_or("0 kB");
    let kilobytes: u64 = line.trim().trim_end_matches(" kB").trim().parse().unwrap();
    assert!(kilobytes < 1 << 20, "{kilobytes} kB were in use at once");
}
