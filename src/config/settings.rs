//! The table of settings: the one place where a setting is defined.

/// Passes the table to the macro `$build`, which makes of it what it needs: the sections with
/// their defaults and checks ([`super::Config`]), or the options of the command line (`cli`).
///
/// A section: name in the file, type, options on the command line `[type, heading of its help]`.
/// A setting: name, type, default (without one it is optional), unit or accepted values, reason;
/// then, each where there is one, the rule a value must meet, and the option or flag that sets it
/// (name, value name, help).
macro_rules! settings {
    ($build:ident) => { $build! {
        /// Conversion of pixel values to linear light.
        light: LightConfig [LightOptions] {
            transfer: Transfer = Transfer::Auto, "auto | linear | srgb | gamma:G",
                "auto: JPEG, PNG-8 and 8-bit rgb/bgr/mono are sRGB-coded; Bayer and 16 bit are \
                 linear",
                option("transfer", "T",
                    "Transfer curve of pixel values to linear light: auto, linear, srgb, gamma:G");
            white_level: u16, "DN",
                "full scale of 16-bit images; where not given, from the bits that are in use";
        }
        /// The seafloor below a frame.
        seafloor: SeafloorConfig [] {
            pings_each_side: usize = 8, "pings",
                "more pings within the window reduce noise; a DVL gives 2 to 15 a second",
                must("be at least 1", |n| *n >= 1);
            ping_window_s: f64 = 1.25, "s",
                "the altitude is a curve in time over this window; pings farther off say little \
                 of the seafloor below the frame",
                must("be above 0", |s| *s > 0.0);
            max_ping_gap_s: f64 = 1.0, "s", "a frame farther from any ping is not corrected",
                must("be above 0", |s| *s > 0.0);
            max_attitude_gap_s: f64 = 0.5, "s", "attitude is not interpolated over a longer gap";
            least_altitude_m: f64 = 0.2, "m", "a plane nearer to the lens is a fish or a fault";
            relief: Switch = Switch::Auto, "auto | off | on",
                "terrain over the plane, from the DVL's returns along the track; auto: where it \
                 predicts held-out returns better than the plane";
        }
        /// Keypoints and their matches.
        matching: MatchingConfig [] {
            detection_side_px: usize = 800, "px",
                "images are reduced to this size at most for keypoints; a patch averages over \
                 more than a pixel",
                must("be at least 64", |n| *n >= 64);
            keypoints_per_frame: usize = 600, "count",
                "more points sample the same few average patches of seafloor";
            contrast_threshold: f64 = 0.02, "log light",
                "in log light a threshold means the same at every brightness";
            ratio: f64 = 0.8, "1", "Lowe's ratio of nearest to second nearest",
                must("lie in 0.3 to 1", |r| (0.3..1.0).contains(r));
            neighbours: usize = 4, "frames",
                "all views of a point must stay in: thinned pairs bias the attenuation";
            inlier_px: f64 = 2.0, "px at detection size", "distance to the homography of the pair";
            least_inliers: usize = 12, "count", "fewer agree by chance";
            footprint_px: f64 = 2.5, "px",
                "standard deviation of the patch in the farther view; the same metres of seafloor \
                 in all views, or the log of the mean is biased",
                must("be at least 0.5", |px| *px >= 0.5);
        }
        /// Pass one.
        estimate: EstimateConfig [EstimateOptions, "Estimation"] {
            estimator: Estimator = Estimator::Auto, "auto | joint | pairs | altitude | empirical",
                "joint where frames overlap, else pairs, else altitude; empirical where \
                 attenuation is not identified and it predicts held-out frames better",
                option("estimator", "NAME", "Estimator of the attenuation");
            spreading: Spreading = Spreading::Strobe, "none | strobe | paper | fit",
                "the strobe's light falls with 1/ℓ_a² (Eq. 4); without it attenuation is only \
                 effective",
                option("spreading", "NAME", "Model of geometric spreading");
            incidence: bool = true, "true | false", "cos γ follows from the plane at no cost";
            strobe_position: StrobePosition = StrobePosition::Auto,
                "auto | fixed | refine | find",
                "0.2 m off doubles the residual and shifts attenuation by 0.02 per metre; the log \
                 determines the position",
                option("strobe-position", "NAME", "Whether the strobe's position is estimated");
            self_calibration: SelfCalibration = SelfCalibration::Auto, "auto | report | off",
                "cameras set their own gain, lenses shade, transfer curves differ from sRGB, \
                 mounts and clocks are off: the log shows it, and attenuation is wrong without it",
                option("self-calibration", "WHEN",
                    "Whether faults of camera, strobe position, clock and mounts are compensated");
            backscatter: Switch = Switch::Auto, "auto | off | on",
                "backscatter adds light: unmodelled, it lowers the attenuation by a sixth",
                option("backscatter", "WHEN", "Whether backscatter is modelled");
            daylight: Switch = Switch::Auto, "auto | off | on",
                "daylight on the seafloor falls with altitude in another way than the strobe's \
                 light: unmodelled, attenuation comes out negative in shallow water",
                option("daylight", "WHEN", "Whether daylight on the seafloor is modelled");
            residual_light: Switch = Switch::Auto, "auto | off | on",
                "lamps of unlike patterns leave light that one beam pattern does not explain: \
                 colour errors are three times as large without it",
                option("residual-light", "WHEN",
                    "Whether light that attenuation and beam pattern leave is removed, too");
            drift: Switch = Switch::Auto, "auto | off | on",
                "the water may change along the dive: attenuation at nodes in time",
                option("drift", "WHEN", "Whether attenuation may change along the log");
            first_frames: usize = 60, "frames",
                "pass one begins with this many, in segments where the altitude changes most, one \
                 in each part of the log",
                must("be at least 2", |n| *n >= 2);
            precision_per_m: f64 = 0.004, "1/m",
                "standard deviation of attenuation that is sufficient; until then pass one doubles \
                 the number of frames, up to max_frames. 0: max_frames at once",
                must("not be below 0", |std| *std >= 0.0),
                option("precision", "STD",
                    "Standard deviation of attenuation that is sufficient [1/m]; until it is \
                     reached, pass one takes more frames");
            max_frames: usize = 400, "frames",
                "bounds the cost of pass one on a long dive; segments are spread over the log",
                must("be at least 2", |n| *n >= 2),
                option("max-frames", "N", "Maximum number of frames in pass one");
            attenuation_floor_per_m: f64 = 0.0, "1/m",
                "the paper leaves out per-image values below 0.1; 0 keeps all";
            sweeps: usize = 6, "count",
                "iterations of beam pattern and attenuation, 'we also recompute' (§IV-C)";
            grid_step_px: usize = 16, "px at detection size",
                "blocks over which a frame is sampled for Eq. 17 and Fig. 6",
                must("be at least 2", |n| *n >= 2);
            clipped_above: f64 = 0.985, "share of full scale", "a clipped pixel is no measurement",
                must("lie in 0 to 1", |share| (0.0..=1.0).contains(share));
            dark_below: f64 = 0.0015, "share of full scale",
                "the mean of a log is not the log of a mean: noise near black biases logs down";
            beam_limit_deg: f64 = 70.0, "deg",
                "the beam pattern's grid reaches from minus to plus this in θ and φ",
                must("lie in 10 to 90", |deg| (10.0..90.0).contains(deg));
            beam_nodes: usize = 41, "count", "nodes of that grid per axis",
                must("lie in 8 to 129", |n| (8..=129).contains(n));
            beam_smoothness: f64 = 0.05, "1",
                "weight of the grid's second differences against one observation; stiffer patterns \
                 shift the strobe's position by centimetres";
            rounds: usize = 12, "count", "reweightings of the robust solve";
            least_pairs: usize = 200, "count",
                "fewer matches do not determine three coefficients and a beam pattern";
            least_altitude_spread: f64 = 1.15, "ratio",
                "highest over lowest altitude below which attenuation is not identified";
        }
        /// Pass two.
        render: RenderConfig [RenderOptions, "Correction and output"] {
            method: Method = Method::Full,
                "full | attenuation | beam-pattern | frame-average | range-average | grey-world | \
                 white-patch | homomorphic | homomorphic-surface | ahe",
                "what is removed (Fig. 10); from frame-average on they are baselines, for \
                 comparison (Fig. 4, Eq. 12 to 14)",
                option("method", "NAME",
                    "What is removed (Fig. 10 of the paper), or a baseline to compare (Fig. 4)");
            white_balance: WhiteBalance = WhiteBalance::GreyWorld, "grey-world | none | [r, g, b]",
                "one per log, never per image";
            highlight_quantile: f64 = 0.995, "share",
                "one exposure per log: this share of the seafloor stays below highlight_level";
            highlight_level: f64 = 0.75, "share of white",
                "leaves headroom for single bright pixels";
            median_level: f64 = 0.45, "share of white",
                "the median seafloor is no brighter: most have about 0.4, an even one would be \
                 near white",
                must("lie in 0.01 to 1", |share| (0.01..=1.0).contains(share));
            look: Look = Look::Measured, "measured | natural",
                "natural: a tone curve for people, in 8 bits only",
                option("look", "LOOK", "How corrected light is shown in 8-bit images");
            shoulder_from: f64 = 0.75, "share of white",
                "above it 8-bit images are compressed towards white instead of clipped; 1 clips. \
                 16-bit images are never compressed",
                must("lie in 0.1 to 1", |share| (0.1..=1.0).contains(share));
            gain_signal_to_noise: f64 = 5.0, "1",
                "a band of this signal-to-noise ratio keeps half of its own colour, a weaker one \
                 less; noise stays below one over it of the median seafloor",
                must("lie in 0.1 to 1000", |ratio| (0.1..=1000.0).contains(ratio));
            least_signal_to_noise: f64 = 10.0, "1",
                "pixels below it are counted in low_signal_share: a tenth of the value is noise \
                 there";
            gain_error: f64 = 0.001, "1",
                "maximum relative error of the gain, which is interpolated between nodes of a grid",
                must("lie in 0.00001 to 0.1", |error| (1e-5..=0.1).contains(error));
            mask: bool = false, "true | false",
                "an image of bits beside each corrected one: clipped, gain limited, off the \
                 surface, unseen beam",
                flag("mask",
                    "Add an image of bits beside each corrected one: clipped, gain limited, off \
                     the surface, unseen beam");
            rectify: bool = false, "true | false", "removes lens distortion as well (Fig. 2)",
                flag("rectify", "Remove lens distortion as well");
            image_format: ImageFormat = ImageFormat::Auto, "auto | jpeg | png | raw | same",
                "auto: PNG where the source is PNG or depth is 16, else JPEG",
                option("image-format", "FORMAT", "Format of corrected images");
            jpeg_quality: JpegQuality = JpegQuality::Auto, "auto | 1 to 100",
                "auto: the source's own where that is JPEG, at most 95, which leaves no visible \
                 artefacts, and lower where corrected images would take more than 1.05 times its \
                 bytes; else 95",
                must("be auto or lie in 1 to 100", |quality| quality.is_valid()),
                option("jpeg-quality", "Q",
                    "JPEG quality of corrected images, 1 to 100; auto: that of the source, at \
                     most 95, lower where they would be larger");
            depth: u8 = 8, "8 | 16", "8 is sRGB-coded, 16 is linear",
                must("be 8 or 16", |bits| matches!(bits, 8 | 16)),
                option("depth", "BITS",
                    "Bits per channel of corrected images: 8 (sRGB-coded) or 16 (linear)");
        }
        /// The file that is written.
        output: OutputConfig [OutputOptions, "Correction and output"] {
            encoding: OutputEncoding = OutputEncoding::Auto, "auto | cdr | ros1 | protobuf",
                "of added messages. auto: protobuf where the camera's channel is, else CDR, which \
                 both viewers show",
                option("output-encoding", "NAME", "Encoding of the added messages");
            compression: Compression = Compression::Auto, "auto | zstd | lz4 | none",
                "of chunks. auto: the input's as they are, none for JPEG, PNG and WebP, which gain \
                 nothing, zstd for all else; another: all chunks",
                option("compression", "NAME", "Compression of chunks");
            chunk_size_mib: u64 = 4, "MiB", "a chunk should hold several frames",
                must("lie in 1 to 1024", |mib| (1..=1024).contains(mib));
            drop_raw: bool = false, "true | false", "leaves out the corrected camera's own images",
                flag("drop-raw", "Leave out the corrected camera's own images");
            only: String, "regex", "keeps only topics that match; what unwater adds stays",
                option("only", "TOPIC_REGEX",
                    "Keep only input topics that match; what unwater adds stays");
            seafloor_points_across: usize = 64, "points",
                "the seafloor in the viewers' 3-D panels: points along an image's width, 16 bytes \
                 each; 0: none",
                must("be at most 4096", |n| *n <= 4096);
            seafloor_interval_s: f64 = 1.0, "s",
                "the seafloor in 3-D at most this often, and rarer or coarser where it would be \
                 more than 4 % of the images; 0: with every frame, whatever it takes",
                must("be 0 or more", |s| *s >= 0.0);
            raw_preview_side_px: usize = 960, "px",
                "raw images that a viewer cannot draw (16 bits, mono, packed) get an 8-bit \
                 preview, this large at most; 0: none";
        }
    } };
}
pub(crate) use settings;
