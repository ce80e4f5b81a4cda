//! A layout file for Foxglove and Lichtblick: the settings of the panels, and a tree of splits.

use serde_json::{Value, json};

use super::{CameraTopics, bands};

/// Settings of the panels, by id.
#[derive(Default)]
struct Panels {
    configs: serde_json::Map<String, Value>,
}

impl Panels {
    fn add(&mut self, kind: &str, config: Value) -> Value {
        let id = format!("{kind}!unwater{}", self.configs.len() + 1);
        self.configs.insert(id.clone(), config);
        json!(id)
    }
}

/// The layout as JSON, for "Import from file".
pub fn foxglove(cameras: &[CameraTopics]) -> String {
    let mut panels = Panels::default();
    let mut trees: Vec<(String, Value)> =
        cameras.iter().map(|c| (c.name.clone(), of_camera(c, &mut panels))).collect();
    let root = if trees.len() == 1 {
        trees.remove(0).1
    } else {
        let tabs: Vec<Value> = trees
            .into_iter()
            .map(|(title, layout)| json!({ "title": title, "layout": layout }))
            .collect();
        panels.add("Tab", json!({ "activeTabIdx": 0, "tabs": tabs }))
    };
    let layout = json!({
        "configById": panels.configs,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": { "speed": 1 },
        "layout": root,
    });
    serde_json::to_string_pretty(&layout).unwrap_or_default() + "\n"
}

fn of_camera(camera: &CameraTopics, panels: &mut Panels) -> Value {
    let image = |panels: &mut Panels, topic: &Option<String>, title: &str| {
        topic.as_ref().map(|t| {
            panels.add(
                "Image",
                json!({ "imageMode": { "imageTopic": t }, "foxglovePanelTitle": title }),
            )
        })
    };
    let images = [image(panels, &camera.raw, "raw"), image(panels, &camera.corrected, "corrected")];
    let scene = camera.cloud.as_ref().map(|_| panels.add("3D", scene(camera)));
    let top = row([row(images, 50), scene], 66);

    let plot = |panels: &mut Panels, title: &str, paths: Vec<Value>| {
        (!paths.is_empty()).then(|| panels.add("Plot", plot(title, &paths)))
    };
    let line = |topic: &Option<String>, label: &str, colour: &str| {
        topic.iter().map(|t| series(&format!("{t}.data[0]"), label, colour)).collect::<Vec<_>>()
    };
    let alphas = camera.attenuation.iter().flat_map(|t| {
        bands(camera.bands)
            .iter()
            .enumerate()
            .map(move |(i, (name, colour))| series(&format!("{t}.data[{i}]"), name, colour))
    });
    let attenuation = plot(panels, "attenuation [1/m]", alphas.collect());
    let altitude =
        plot(panels, "camera altitude [m]", line(&camera.altitude, "altitude", "#3e84f7"));
    let residual =
        plot(panels, "seafloor residual [m]", line(&camera.residual, "residual", "#e5484d"));
    let beam = image(panels, &camera.beam_pattern, "beam pattern");
    let log = camera.log.as_ref().map(|t| {
        panels.add("RosOut", json!({ "topicToRender": t, "minLogLevel": 1, "searchTerms": [] }))
    });
    let bottom =
        row([row([attenuation, column([altitude, residual], 50)], 50), row([beam, log], 40)], 60);
    column([top, bottom], 62).unwrap_or(Value::Null)
}

/// Corrected image on the seafloor, strobe and beam, in the seafloor's frame (z up).
fn scene(camera: &CameraTopics) -> Value {
    let mut topics = serde_json::Map::new();
    let mut show = |topic: &Option<String>, settings: Value| {
        if let Some(topic) = topic {
            topics.insert(topic.clone(), settings);
        }
    };
    let points = |size: f64| {
        let shape = "square";
        json!({ "visible": true, "pointShape": shape, "pointSize": size, "decayTime": 0 })
    };
    show(&camera.cloud, points(5.0));
    show(&camera.strobe_beam, points(3.0));
    show(&camera.strobe, json!({ "visible": true, "type": "axis", "axisScale": 0.3 }));
    show(&camera.camera_info, json!({ "visible": true, "distance": 0.5, "color": "#7c6bffff" }));
    json!({
        "foxglovePanelTitle": "seafloor",
        "cameraState": {
            "perspective": true, "distance": 7, "phi": 62, "thetaOffset": 30,
            "targetOffset": [0, 0, 0.8], "target": [0, 0, 0], "targetOrientation": [0, 0, 0, 1],
            "fovy": 45, "near": 0.05, "far": 500,
        },
        "followMode": "follow-pose",
        "followTf": camera.seafloor_frame,
        "scene": {
            "transforms": {
                "axisScale": 0.3, "showLabel": false, "lineWidth": 1, "lineColor": "#8a8a8a60",
            },
        },
        "transforms": {},
        "topics": topics,
        "layers": {
            "grid": {
                "visible": true, "frameLocked": true, "label": "Grid", "instanceId": "grid",
                "layerId": "foxglove.Grid", "size": 10, "divisions": 10, "lineWidth": 1,
                "color": "#24808080", "position": [0, 0, 0], "rotation": [0, 0, 0],
            },
        },
        "publish": {},
        "imageMode": {},
    })
}

fn plot(title: &str, paths: &[Value]) -> Value {
    json!({
        "foxglovePanelTitle": title,
        "paths": paths,
        "showXAxisLabels": true, "showYAxisLabels": true,
        "showLegend": true, "legendDisplay": "floating", "showPlotValuesInLegend": true,
        "isSynced": true, "xAxisVal": "timestamp", "sidebarDimension": 240,
    })
}

fn series(path: &str, label: &str, colour: &str) -> Value {
    json!({
        "value": path, "label": label, "color": colour, "enabled": true,
        "timestampMethod": "receiveTime",
    })
}

fn row(parts: [Option<Value>; 2], percent: u32) -> Option<Value> {
    split("row", parts, percent)
}

fn column(parts: [Option<Value>; 2], percent: u32) -> Option<Value> {
    split("column", parts, percent)
}

/// Two parts beside each other, the first with `percent` of the space; one part alone where the
/// other is missing.
fn split(direction: &str, parts: [Option<Value>; 2], percent: u32) -> Option<Value> {
    match parts {
        [Some(first), Some(second)] => Some(json!({
            "direction": direction, "splitPercentage": percent, "first": first, "second": second,
        })),
        [one, other] => one.or(other),
    }
}
