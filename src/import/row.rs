//! A row of a navigation table: when and where a still was taken.

use super::table::{Table, unit};

/// Columns by what they hold, with the plain names that programs give them (auv_nav, IMOS/ACFR,
/// BIIGLE, iFDO).
const NAMES: [(Quantity, &[&str]); 10] = [
    (
        Quantity::File,
        &[
            "filename",
            "file",
            "imagefilename",
            "image",
            "imagename",
            "relativepath",
            "path",
            "pathbest",
            "label",
            "leftimagename",
            "key",
        ],
    ),
    (
        Quantity::Time,
        &[
            "timestamp",
            "imagedatetime",
            "takenat",
            "subdatetime",
            "datetime",
            "timestampstart",
            "time",
            "utc",
        ],
    ),
    (Quantity::Latitude, &["latitude", "lat", "imagelatitude", "sublatitude", "poselat"]),
    (
        Quantity::Longitude,
        &["longitude", "lon", "lng", "imagelongitude", "sublongitude", "poselon"],
    ),
    (
        Quantity::Altitude,
        &[
            "altitude",
            "distancetoground",
            "imagemetersaboveground",
            "altitudesensor",
            "alt",
            "subdistance",
            "posealt",
        ],
    ),
    (Quantity::Depth, &["depth", "posedep", "depthsensor", "subdepth"]),
    (Quantity::Height, &["imagealtitudemeters", "gpsaltitude", "subaltitude"]),
    (Quantity::Heading, &["heading", "yaw", "imagecamerayawdegrees", "subheading", "posedatayaw"]),
    (Quantity::Pitch, &["pitch", "imagecamerapitchdegrees", "posedatapitch"]),
    (Quantity::Roll, &["roll", "imagecamerarolldegrees", "posedataroll"]),
];

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Quantity {
    File,
    Time,
    Latitude,
    Longitude,
    /// above the seafloor
    Altitude,
    Depth,
    /// above the sea surface: the negative depth
    Height,
    Heading,
    Pitch,
    Roll,
}

/// A still.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// as in the table
    pub file: String,
    /// UTC (ns); `None` where no column is the time
    pub stamp_ns: Option<i64>,
    /// latitude and longitude (deg)
    pub position_deg: Option<[f64; 2]>,
    /// above the seafloor (m)
    pub altitude_m: Option<f64>,
    /// below the sea surface (m)
    pub depth_m: Option<f64>,
    /// heading, pitch and roll (rad)
    pub attitude_rad: Option<[f64; 3]>,
}

/// Rows of a table, and which of its columns are used, with units.
///
/// # Errors
/// A sentence: which column is missing, or which cell cannot be read.
pub fn rows(table: &Table, utc_offset_s: i64) -> Result<(Vec<Row>, Vec<String>), String> {
    let column = |quantity: Quantity| {
        let names = NAMES.iter().find(|(q, _)| *q == quantity).map_or(&[][..], |(_, names)| names);
        table.column(names)
    };
    let needed = |quantity, what: &str| {
        column(quantity).ok_or_else(|| {
            format!("no column is {what}; the columns are {}", table.columns.join(", "))
        })
    };
    let file = needed(Quantity::File, "the file name")?;
    needed(Quantity::Altitude, "the altitude above the seafloor")?;
    let scale = |quantity| column(quantity).map_or(1.0, |at| scale(&table.columns[at], quantity));
    let mut found = Vec::new();
    for (number, row) in (2..).zip(&table.rows) {
        let bad = |what: &str, cell: &str| format!("row {number}: {what} is {cell:?}");
        let value = |quantity: Quantity| -> Result<Option<f64>, String> {
            let Some(cell) = table.cell(row, column(quantity)) else { return Ok(None) };
            let number: f64 =
                cell.parse().map_err(|_no_number| bad(&format!("{quantity:?}"), cell))?;
            Ok(Some(number * scale(quantity)).filter(|v| v.is_finite()))
        };
        let Some(name) = table.cell(row, Some(file)) else { continue };
        let stamp_ns = column(Quantity::Time).map(|time| {
            let cell = table.cell(row, Some(time)).unwrap_or_default();
            stamp_ns(cell, utc_offset_s).ok_or_else(|| bad("the time", cell))
        });
        let position_deg = value(Quantity::Latitude)?.zip(value(Quantity::Longitude)?);
        let depth_m = value(Quantity::Depth)?.or(value(Quantity::Height)?.map(|height| -height));
        let (heading, pitch, roll) =
            (value(Quantity::Heading)?, value(Quantity::Pitch)?, value(Quantity::Roll)?);
        let has_attitude = pitch.is_some() && roll.is_some();
        let attitude_rad = [heading, pitch, roll].map(Option::unwrap_or_default);
        found.push(Row {
            file: name.into(),
            stamp_ns: stamp_ns.transpose()?,
            position_deg: position_deg.map(|(latitude, longitude)| [latitude, longitude]),
            altitude_m: value(Quantity::Altitude)?.filter(|altitude| *altitude > 0.0),
            depth_m,
            attitude_rad: has_attitude.then_some(attitude_rad),
        });
    }
    let used = NAMES.iter().filter_map(|(quantity, _)| {
        let name = &table.columns[column(*quantity)?];
        Some(format!("{name}: {}", meaning(*quantity, name)))
    });
    Ok((found, used.collect()))
}

/// Factor from the unit in a column's name to radian or metre; degrees where it has none.
fn scale(name: &str, quantity: Quantity) -> f64 {
    let unit = unit(name).unwrap_or_default().to_ascii_lowercase();
    match quantity {
        Quantity::Heading | Quantity::Pitch | Quantity::Roll if !unit.starts_with("rad") => {
            std::f64::consts::PI / 180.0
        }
        Quantity::Altitude | Quantity::Depth | Quantity::Height => match unit.as_str() {
            "mm" => 1e-3,
            "cm" => 1e-2,
            _ => 1.0,
        },
        Quantity::Latitude | Quantity::Longitude if unit.starts_with("rad") => {
            180.0 / std::f64::consts::PI
        }
        _ => 1.0,
    }
}

fn meaning(quantity: Quantity, name: &str) -> String {
    let given = unit(name).filter(|unit| !unit.is_empty());
    let of = |default: &str| given.unwrap_or(default).to_string();
    match quantity {
        Quantity::File => "file name".into(),
        Quantity::Time => "time".into(),
        Quantity::Latitude => format!("latitude [{}]", of("deg")),
        Quantity::Longitude => format!("longitude [{}]", of("deg")),
        Quantity::Altitude => format!("altitude above the seafloor [{}]", of("m")),
        Quantity::Depth => format!("depth [{}]", of("m")),
        Quantity::Height => format!("altitude above the sea surface [{}]", of("m")),
        Quantity::Heading => format!("heading [{}]", of("deg")),
        Quantity::Pitch => format!("pitch [{}]", of("deg")),
        Quantity::Roll => format!("roll [{}]", of("deg")),
    }
}

/// A moment: seconds, milliseconds, microseconds or nanoseconds since 1970, or a date and time. One
/// without a zone has the offset that is given.
pub fn stamp_ns(text: &str, utc_offset_s: i64) -> Option<i64> {
    if let Ok(number) = text.parse::<f64>() {
        return epoch_ns(text, number);
    }
    let text = text.trim().replace('/', "-").replacen('T', " ", 1);
    let (text, zone_s) = zone(&text);
    // EXIF has colons in its dates.
    let (date, time) = text.split_once(' ')?;
    let moment = format!("{}T{}Z", date.replace(':', "-"), time.trim());
    let at = humantime::parse_rfc3339_weak(&moment).ok()?;
    let since = at.duration_since(std::time::UNIX_EPOCH).ok()?;
    let offset_ns = zone_s.unwrap_or(utc_offset_s).checked_mul(1_000_000_000)?;
    i64::try_from(since.as_nanos()).ok()?.checked_sub(offset_ns)
}

/// Seconds that nanoseconds of 64 bits hold.
const MAX_SECONDS: f64 = 9.2e9;

/// By its size, the number's unit; the digits after the point are kept.
fn epoch_ns(text: &str, number: f64) -> Option<i64> {
    let digits: u32 = match number {
        n if n >= 1e17 => 0,
        n if n >= 1e14 => 3,
        n if n >= 1e11 => 6,
        n if n >= 1e8 => 9,
        _ => return None,
    };
    // Spreadsheets write large numbers in scientific notation, to few digits.
    if text.contains(['e', 'E']) {
        let seconds = number / 10_f64.powi(9 - digits as i32);
        let is_sane = seconds.abs() < MAX_SECONDS;
        return is_sane.then(|| (seconds * 1e9).round() as i64);
    }
    let (whole, part) = text.trim().split_once('.').unwrap_or((text.trim(), ""));
    let part: String = part.chars().chain("000000000".chars()).take(digits as usize).collect();
    let part: i64 = if part.is_empty() { 0 } else { part.parse().ok()? };
    whole.parse::<i64>().ok()?.checked_mul(10_i64.checked_pow(digits)?)?.checked_add(part)
}

/// `… +10:00` → the rest, and 36000 s; `Z` is 0.
fn zone(text: &str) -> (&str, Option<i64>) {
    if let Some(rest) = text.strip_suffix(['Z', 'z']) {
        return (rest.trim(), Some(0));
    }
    let at = text.rfind(['+', '-']).filter(|at| text[..*at].contains(':'));
    let found = at.and_then(|at| Some((&text[..at], offset_s(&text[at..])?)));
    found.map_or((text, None), |(rest, offset)| (rest.trim(), Some(offset)))
}

/// `+10:00` → 36000
pub fn offset_s(text: &str) -> Option<i64> {
    let sign = match text.chars().next()? {
        '+' => 1,
        '-' => -1,
        _ => return None,
    };
    let (hours, minutes) = text[1..].split_once(':').unwrap_or((&text[1..], "0"));
    let (hours, minutes): (i64, i64) = (hours.parse().ok()?, minutes.parse().ok()?);
    let is_sane = (0..=14).contains(&hours) && (0..60).contains(&minutes);
    is_sane.then_some(sign * (hours * 3600 + minutes * 60))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_read_in_every_usual_form() {
        let at = 1_577_934_245_500_000_000;
        for text in [
            "2020-01-02 03:04:05.5",
            "2020-01-02T03:04:05.500Z",
            "2020/01/02 03:04:05.5",
            "2020:01:02 03:04:05.5",
            "2020-01-02T13:04:05.5+10:00",
            "2020-01-01 22:34:05.5-04:30",
            "1577934245.5",
            "1577934245500",
            "1577934245500000",
            "1577934245500000000",
            "1.5779342455e+18",
            "1.5779342455E9",
        ] {
            assert_eq!(stamp_ns(text, 0), Some(at), "{text}");
        }
        assert_eq!(stamp_ns("2020-01-02 13:04:05.5", 36_000), Some(at));
        for text in ["", "yesterday", "12.5", "2020-01-02", "+", "9e99"] {
            assert_eq!(stamp_ns(text, 0), None, "{text}");
        }
        assert_eq!(offset_s("+25:00"), None);
    }

    #[test]
    fn columns_are_found_by_the_names_of_other_programs() {
        for head in [
            "relative_path,timestamp [s],latitude [deg],longitude [deg],altitude [m],depth [m],\
             heading [deg],pitch [deg],roll [deg]",
            "filename,taken_at,lat,lng,distance_to_ground,depth,yaw,pitch,roll",
            "key,timestamp_start,pose.lat,pose.lon,pose.alt,pose.dep,heading,pitch,roll",
        ] {
            let text = format!("{head}\na.jpg,1577934245.5,60,10,2.5,30,90,0,-90\n");
            let table = Table::parse(&text).expect("a table");
            let (rows, used) = rows(&table, 0).expect(head);
            assert_eq!(used.len(), 9, "{used:?}");
            let quarter = std::f64::consts::FRAC_PI_2;
            let expected = Row {
                file: "a.jpg".into(),
                stamp_ns: Some(1_577_934_245_500_000_000),
                position_deg: Some([60.0, 10.0]),
                altitude_m: Some(2.5),
                depth_m: Some(30.0),
                attitude_rad: Some([quarter, 0.0, -quarter]),
            };
            assert_eq!(rows, [expected]);
        }
        let table = Table::parse("filename,time\na,1577934245\n").expect("a table");
        assert!(rows(&table, 0).expect_err("no altitude").contains("altitude"));
    }
}
