//! Lists of the stills for other programs: BIIGLE, SQUIDLE+, Metashape, OpenDroneMap, and maps.

use std::fmt::Write as _;

use serde_json::{Value as Json, json};

use super::still::{Still, millimetres, utc};

/// A number, empty where it is not known.
fn cell(value: Option<f64>) -> String {
    value.filter(|v| v.is_finite()).map_or_else(String::new, |v| millimetres(v).to_string())
}

/// Degrees in full, empty where they are not known.
fn degrees(value: Option<f64>) -> String {
    value.map_or_else(String::new, |v| v.to_string())
}

fn table(head: &str, stills: &[Still<'_>], row: impl Fn(&Still<'_>) -> Option<String>) -> String {
    let mut text = format!("{head}\n");
    for line in stills.iter().filter_map(row) {
        let written = writeln!(text, "{line}");
        debug_assert!(written.is_ok(), "text grows");
    }
    text
}

/// `images.csv`: columns by BIIGLE's names, then our own.
pub fn biigle(stills: &[Still<'_>]) -> String {
    let head = "filename,taken_at,lng,lat,distance_to_ground,stamp_ns,seafloor_support,\
                seafloor_residual_m,gps_altitude,yaw";
    table(head, stills, |still| {
        let Still { name, record, fix, depth_m, .. } = still;
        let seafloor = record.seafloor.as_ref();
        let (lng, lat) = (fix.map(|f| f.longitude), fix.map(|f| f.latitude));
        Some(format!(
            "{name},{},{},{},{},{},{},{},{},{}",
            utc(record.stamp),
            degrees(lng),
            degrees(lat),
            cell(Some(record.altitude_m)),
            record.stamp.0,
            seafloor.map_or("", |f| f.support.as_str()),
            cell(seafloor.map(|f| f.residual_m)),
            cell(depth_m.map(|d| -d)),
            cell(yaw(still)),
        ))
    })
}

/// Heading of the top of the image, from 0 to 360°.
fn yaw(still: &Still<'_>) -> Option<f64> {
    still.yaw_pitch_roll_deg().map(|[yaw, ..]| yaw.rem_euclid(360.0))
}

/// `squidle.csv`: fields of a media item and its pose in SQUIDLE+.
pub fn squidle(stills: &[Still<'_>]) -> String {
    let head = "key,path_best,timestamp_start,pose.timestamp,pose.lat,pose.lon,pose.dep,pose.alt,\
                pose.data.yaw,pose.data.pitch,pose.data.roll";
    table(head, stills, |still| {
        let Still { name, record, fix, depth_m, .. } = still;
        let key = name.rsplit_once('.').map_or(name.as_str(), |(stem, _)| stem);
        let at = utc(record.stamp);
        let [yaw, pitch, roll] = still.yaw_pitch_roll_deg().map_or([None; 3], |a| a.map(Some));
        Some(format!(
            "{key},images/{name},{at},{at},{},{},{},{},{},{},{}",
            degrees(fix.map(|f| f.latitude)),
            degrees(fix.map(|f| f.longitude)),
            cell(*depth_m),
            cell(Some(record.altitude_m)),
            cell(yaw),
            cell(pitch),
            cell(roll),
        ))
    })
}

/// `reference.csv` for Metashape: geographic coordinates where the log has them, else local ones;
/// `None` where it has neither.
pub fn metashape(stills: &[Still<'_>]) -> Option<String> {
    let is_geographic = stills.iter().any(|s| s.fix.is_some());
    if !is_geographic && stills.iter().all(|s| s.pose.is_none()) {
        return None;
    }
    let head = if is_geographic {
        "label,longitude,latitude,altitude,yaw,pitch,roll"
    } else {
        "label,x,y,z,yaw,pitch,roll"
    };
    Some(table(head, stills, |still| {
        let place = if is_geographic {
            let fix = still.fix?;
            let altitude = cell(still.depth_m.map(|d| -d));
            format!("{},{},{altitude}", fix.longitude, fix.latitude)
        } else {
            let at = still.pose?.translation.vector;
            format!("{},{},{}", millimetres(at.x), millimetres(at.y), millimetres(at.z))
        };
        let [_, pitch, roll] = still.yaw_pitch_roll_deg().map_or([None; 3], |a| a.map(Some));
        let angles = [yaw(still), pitch, roll].map(cell).join(",");
        Some(format!("{},{place},{angles}", still.name))
    }))
}

/// `geo.txt` for OpenDroneMap; `None` without positions.
pub fn open_drone_map(stills: &[Still<'_>]) -> Option<String> {
    stills.iter().any(|s| s.fix.is_some()).then(|| {
        table("EPSG:4326", stills, |still| {
            let fix = still.fix?;
            let place = format!("{} {} {}", still.name, fix.longitude, fix.latitude);
            // Angles follow the altitude in this format, so that they need one.
            let Some(depth_m) = still.depth_m else { return Some(place) };
            let place = format!("{place} {}", -millimetres(depth_m));
            let Some([_, pitch, roll]) = still.yaw_pitch_roll_deg() else { return Some(place) };
            let yaw = yaw(still).unwrap_or_default();
            let [yaw, pitch, roll] = [yaw, pitch, roll].map(millimetres);
            Some(format!("{place} {yaw} {pitch} {roll}"))
        })
    })
}

/// `track.geojson`: the track as a line, and a point per still; `None` without positions.
pub fn track(stills: &[Still<'_>]) -> Option<Json> {
    let at = |still: &Still<'_>| {
        let fix = still.fix?;
        let depth = still.depth_m.map(|d| json!(-millimetres(d)));
        let place = [json!(fix.longitude), json!(fix.latitude)];
        Some(place.into_iter().chain(depth).collect::<Vec<Json>>())
    };
    let places: Vec<Vec<Json>> = stills.iter().filter_map(at).collect();
    let first = places.first()?.clone();
    // A line has two positions at least.
    let line = if places.len() > 1 {
        json!({ "type": "LineString", "coordinates": places })
    } else {
        json!({ "type": "Point", "coordinates": first })
    };
    let mut features =
        vec![json!({ "type": "Feature", "geometry": line, "properties": { "name": "track" } })];
    for still in stills {
        let Some(place) = at(still) else { continue };
        let altitude = still.record.altitude_m;
        features.push(json!({
            "type": "Feature",
            "geometry": { "type": "Point", "coordinates": place },
            "properties": {
                "name": still.name,
                "time": format!("{}Z", utc(still.record.stamp).replace(' ', "T")),
                "distance_to_ground_m": altitude.is_finite().then(|| millimetres(altitude)),
            },
        }));
    }
    Some(json!({ "type": "FeatureCollection", "features": features }))
}
