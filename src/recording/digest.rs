//! Fingerprints of the messages of a channel, to compare two logs without keeping them.

use sha2::Digest as _;

/// Fingerprints of consecutive messages of a channel, a few at a time.
#[derive(Clone, Debug, Default)]
pub struct ChannelDigest {
    /// messages
    pub count: u64,
    /// per group: log time of its first message (ns) and fingerprint
    groups: Vec<(u64, [u8; 16])>,
    open: Option<(u64, sha2::Sha256)>,
    group_size: u64,
}

/// Where two channels differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Difference {
    /// groups that differ
    pub groups: u64,
    /// log time of the first message of the first of them (ns)
    pub first_ns: u64,
}

/// What of a message is compared.
#[derive(Clone, Copy, Debug)]
pub struct Fingerprinted<'m> {
    /// 0 where it is not compared
    pub sequence: u32,
    /// when it was recorded (ns)
    pub log_time: u64,
    /// when it was published (ns)
    pub publish_time: u64,
    /// payload
    pub data: &'m [u8],
}

impl ChannelDigest {
    /// Without messages yet.
    pub fn of_groups(group_size: u64) -> Self {
        Self { group_size, ..Self::default() }
    }

    /// Adds the next message.
    pub fn add(&mut self, message: Fingerprinted<'_>) {
        let Fingerprinted { sequence, log_time, publish_time, data } = message;
        let (_, hash) = self.open.get_or_insert_with(|| (log_time, sha2::Sha256::new()));
        hash.update(sequence.to_le_bytes());
        hash.update(log_time.to_le_bytes());
        hash.update(publish_time.to_le_bytes());
        hash.update((data.len() as u64).to_le_bytes());
        hash.update(data);
        self.count += 1;
        if self.count.is_multiple_of(self.group_size.max(1)) {
            self.close();
        }
    }

    /// Closes the last group.
    pub fn close(&mut self) {
        if let Some((log_time, hash)) = self.open.take() {
            let hash = hash.finalize();
            self.groups.push((log_time, std::array::from_fn(|i| hash[i])));
        }
    }

    /// Where another channel differs from this one; both must be closed.
    pub fn difference(&self, other: &Self) -> Option<Difference> {
        let longest = self.groups.len().max(other.groups.len());
        let of = |digest: &Self, i: usize| digest.groups.get(i).copied();
        let differs = |i: &usize| of(self, *i) != of(other, *i);
        let first = (0..longest).find(differs)?;
        let groups = (first..longest).filter(differs).count() as u64;
        let first_ns = of(self, first).or_else(|| of(other, first)).unwrap_or_default().0;
        Some(Difference { groups, first_ns })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_and_a_missing_message_are_found() {
        let digest = |messages: &[(u64, &[u8])]| {
            let mut digest = ChannelDigest::of_groups(1);
            for (log_time, data) in messages {
                let (sequence, publish_time) = (0, *log_time);
                digest.add(Fingerprinted { sequence, log_time: *log_time, publish_time, data });
            }
            digest.close();
            digest
        };
        let whole = digest(&[(1, b"a"), (2, b"b"), (3, b"c")]);
        assert_eq!(whole.difference(&whole.clone()), None);
        let changed = digest(&[(1, b"a"), (2, b"x"), (3, b"c")]);
        let difference = Difference { groups: 1, first_ns: 2 };
        assert_eq!(whole.difference(&changed), Some(difference));
        let missing = digest(&[(1, b"a"), (2, b"b")]);
        assert_eq!(whole.difference(&missing), Some(Difference { groups: 1, first_ns: 3 }));
    }
}
