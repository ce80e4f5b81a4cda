//! The document of `inspect` as text.

use std::fmt::Write as _;

use serde_json::{Value, json};

use super::super::output::damage_time;
use crate::diagnostics::Severity;
use crate::messages::TYPES;

/// The document as text.
pub fn text(document: &Value) -> String {
    let mut text = Text(String::new());
    text.log(document);
    text.channels(list(&document["channels"]));
    for diagnostic in list(&document["diagnostics"]) {
        text.line(format_args!("note: {}", string(&diagnostic["text"])));
    }
    for damage in list(&document["damage"]) {
        let [start, end] = ["start_ns", "end_ns"].map(|key| damage[key].as_u64().unwrap_or(0));
        let (reason, time) = (string(&damage["reason"]), damage_time(start, end));
        text.line(format_args!("damage: {reason} (byte {}, {time})", damage["offset"]));
    }
    list(&document["plans"]).iter().for_each(|plan| text.plan(plan));
    if let Some(missing) = document["missing"].as_str() {
        text.line(format_args!("cannot be corrected as it is: {missing}"));
    }
    if document["missing_message_type"] == json!(true) {
        let known: Vec<&str> = TYPES.iter().map(|t| t.name).collect();
        text.line(format_args!("message types that are read: {}", known.join(", ")));
    }
    text.0
}

struct Text(String);

impl Text {
    fn line(&mut self, line: std::fmt::Arguments<'_>) {
        let _infallible = writeln!(self.0, "{line}");
    }

    fn log(&mut self, document: &Value) {
        let [start, end] = ["start_ns", "end_ns"].map(|key| document[key].as_u64().unwrap_or(0));
        let seconds = end.saturating_sub(start) as f64 * 1e-9;
        self.line(format_args!(
            "{}: {} messages over {seconds:.1} s, {} chunks, profile {:?}",
            string(&document["file"]),
            document["messages"],
            document["chunks"],
            string(&document["profile"])
        ));
    }

    fn channels(&mut self, channels: &[Value]) {
        let width = channels.iter().map(|c| string(&c["topic"]).len()).max().unwrap_or(0);
        for channel in channels {
            let (topic, schema) = (string(&channel["topic"]), string(&channel["schema"]));
            let count = channel["messages"].as_u64().unwrap_or(0);
            let read =
                channel["read_as"].as_str().map_or("copied".into(), |r| format!("read as {r}"));
            let description = match string(&channel["description"]) {
                "" => String::new(),
                description => format!(", {description}"),
            };
            self.line(format_args!(
                "  {topic:<width$}  {count:>8}  {schema:<42} {read}{description}"
            ));
            if let Some(complaint) = channel["complaint"].as_str() {
                let count = &channel["unreadable"];
                self.line(format_args!(
                    "  {:<width$}            {count} unreadable: {complaint}",
                    ""
                ));
            }
        }
    }

    fn plan(&mut self, plan: &Value) {
        let altitude = plan["camera_altitude_m"].as_array().map_or_else(String::new, |range| {
            let [low, high] = [0, 1].map(|end| range[end].as_f64().unwrap_or(f64::NAN));
            format!(", camera {low:.2} to {high:.2} m above it")
        });
        let (camera, corrected) = (string(&plan["camera"]), string(&plan["corrected_topic"]));
        self.line(format_args!(
            "would correct {camera} ({} frames) into {corrected}",
            plan["frames"]
        ));
        let info = plan["camera_info"].as_str().unwrap_or("the rig file");
        self.line(format_args!("  calibration from {info}"));
        self.line(format_args!(
            "  seafloor from {} ({} pings): below {} frames{altitude}",
            string(&plan["dvl"]),
            plan["pings"],
            plan["frames_with_seafloor"]
        ));
        let attitude = plan["attitude"].as_str().unwrap_or("nothing");
        self.line(format_args!("  attitude from {attitude}"));
        let strobe = plan["strobe"].as_str().unwrap_or("nothing: assumed at the camera");
        self.line(format_args!("  strobe from {strobe}"));
        let memory = plan["memory_at_most_bytes"].as_f64().unwrap_or(f64::NAN) / 1e6;
        self.line(format_args!("  memory at most {memory:.0} MB with {} threads", plan["threads"]));
        let output = plan["output_about_bytes"].as_f64().unwrap_or(f64::NAN) / 1e6;
        self.line(format_args!("  output about {output:.1} MB"));
        list(&plan["clocks"]).iter().for_each(|clock| self.diagnostic("clock", clock));
        for diagnostic in list(&plan["diagnostics"]) {
            let is_info = diagnostic["severity"] == json!(Severity::Info);
            self.diagnostic(if is_info { "note" } else { "warning" }, diagnostic);
        }
    }

    fn diagnostic(&mut self, kind: &str, diagnostic: &Value) {
        self.line(format_args!("  {kind}: {}", string(&diagnostic["text"])));
        if let Some(remedy) = diagnostic["remedy"].as_str() {
            self.line(format_args!("    help: {remedy}"));
        }
    }
}

fn string(value: &Value) -> &str {
    value.as_str().unwrap_or("")
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}
