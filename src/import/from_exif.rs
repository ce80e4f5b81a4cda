//! What a table lacks, from the EXIF of the images.

use super::row::{Row, stamp_ns};
use crate::image::exif::ExifFacts;

/// What was taken from EXIF, in the words of the list of columns.
const WORDS: [&str; 3] = [
    "EXIF DateTimeOriginal: time",
    "EXIF GPSLatitude, GPSLongitude: position [deg]",
    "EXIF GPSAltitude, below the sea surface: depth [m]",
];

/// Completes rows by the EXIF of their images: time, position and depth. Rows that get no time,
/// since their file is no image (`exif` is `None` for it), keep none. Returns what was taken.
///
/// # Errors
/// A sentence: an image has no time.
pub fn complete(
    rows: &mut [Row],
    utc_offset_s: i64,
    exif: impl Fn(&str) -> Option<ExifFacts>,
) -> Result<Vec<String>, String> {
    let mut is_taken = [false; 3];
    let lacks =
        |row: &Row| [row.stamp_ns.is_none(), row.position_deg.is_none(), row.depth_m.is_none()];
    for row in rows.iter_mut().filter(|row| lacks(row).contains(&true)) {
        let Some(facts) = exif(&row.file) else { continue };
        let before = lacks(row);
        if row.stamp_ns.is_none() {
            let stamp = stamp_ns(&facts.taken_at, utc_offset_s).ok_or_else(|| {
                format!("no column is the time, and the EXIF of {} has none", row.file)
            })?;
            row.stamp_ns = Some(stamp);
        }
        row.position_deg = row.position_deg.or(facts.position_deg);
        row.depth_m = row.depth_m.or(facts.depth_m);
        for (taken, (before, after)) in is_taken.iter_mut().zip(before.into_iter().zip(lacks(row)))
        {
            *taken |= before && !after;
        }
    }
    let taken = WORDS.into_iter().zip(is_taken).filter(|(_, taken)| *taken);
    Ok(taken.map(|(words, _)| words.into()).collect())
}

#[cfg(test)]
mod tests {
    use super::super::row::rows;
    use super::super::table::Table;
    use super::*;

    #[test]
    fn what_the_table_lacks_is_read_from_exif() {
        let exif = |file: &str| match file {
            "a.jpg" => Some(ExifFacts {
                taken_at: "2020:01:02 13:04:05.5".into(),
                position_deg: Some([60.0, -10.0]),
                depth_m: Some(30.0),
                ..ExifFacts::default()
            }),
            "b.jpg" => Some(ExifFacts::default()),
            _ => None,
        };
        let of = |text: &str| {
            let table = Table::parse(text).expect("a table");
            let mut rows = rows(&table, 0).expect("rows").0;
            complete(&mut rows, 36_000, exif).map(|taken| (rows, taken))
        };
        let (rows, taken) =
            of("file,altitude,depth\na.jpg,2.5,31\nmissing.jpg,2,1\n").expect("rows");
        assert_eq!(rows[0].stamp_ns, Some(1_577_934_245_500_000_000));
        // A column goes before EXIF.
        assert_eq!((rows[0].position_deg, rows[0].depth_m), (Some([60.0, -10.0]), Some(31.0)));
        assert_eq!(rows[1].stamp_ns, None);
        assert_eq!(taken, WORDS[..2]);
        let error = of("file,altitude\nb.jpg,2.5\n").expect_err("no time");
        assert!(error.contains("EXIF of b.jpg"), "{error}");
    }
}
