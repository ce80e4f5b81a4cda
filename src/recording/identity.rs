//! Whether two paths lead to the same file: by symbolic links, hard links or `./`.

use std::path::Path;

/// What identifies a file that exists, whatever path leads to it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct FileIdentity(Identity);

#[cfg(unix)]
type Identity = (u64, u64);
#[cfg(not(unix))]
type Identity = std::path::PathBuf;

impl FileIdentity {
    /// That of the file at a path; `None` where there is none.
    #[cfg(unix)]
    pub fn of(path: &Path) -> Option<Self> {
        use std::os::unix::fs::MetadataExt;
        std::fs::metadata(path).ok().map(|found| Self((found.dev(), found.ino())))
    }

    /// That of the file at a path; `None` where there is none.
    #[cfg(not(unix))]
    pub fn of(path: &Path) -> Option<Self> {
        std::fs::canonicalize(path).ok().map(Self)
    }

    /// Whether both paths lead to one file.
    pub fn is_same(a: &Path, b: &Path) -> bool {
        Self::of(a).is_some_and(|id| Some(id) == Self::of(b))
    }
}
