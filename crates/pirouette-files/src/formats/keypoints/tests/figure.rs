//! One person, written by hand, in every format.

use glam::DVec2;
use pirouette::scan::KeypointKind;
use pirouette_body::Joint;

use super::super::layout::{self, Layout, MEDIAPIPE_NAMES};

pub(super) const WIDTH: usize = 400;
pub(super) const HEIGHT: usize = 600;

/// A person seen from the front, in px: left joints are on the right side of the photo
pub(super) const FIGURE: [(Joint, f64, f64); 23] = [
    (Joint::Nose, 201.0, 60.0),
    (Joint::LeftEye, 208.0, 52.0),
    (Joint::RightEye, 194.0, 53.0),
    (Joint::LeftEar, 219.0, 58.0),
    (Joint::RightEar, 183.0, 59.0),
    (Joint::LeftShoulder, 248.0, 120.0),
    (Joint::RightShoulder, 152.0, 122.0),
    (Joint::LeftElbow, 281.0, 190.0),
    (Joint::RightElbow, 119.0, 194.0),
    (Joint::LeftWrist, 307.0, 260.0),
    (Joint::RightWrist, 93.0, 262.0),
    (Joint::LeftHip, 228.0, 290.0),
    (Joint::RightHip, 172.0, 292.0),
    (Joint::LeftKnee, 233.0, 410.0),
    (Joint::RightKnee, 167.0, 413.0),
    (Joint::LeftAnkle, 237.0, 525.0),
    (Joint::RightAnkle, 163.0, 528.0),
    (Joint::LeftBigToe, 249.0, 556.0),
    (Joint::LeftSmallToe, 262.0, 551.0),
    (Joint::LeftHeel, 234.0, 540.0),
    (Joint::RightBigToe, 151.0, 558.0),
    (Joint::RightSmallToe, 138.0, 553.0),
    (Joint::RightHeel, 166.0, 543.0),
];

/// Returns the position of a joint of the figure; necks and hips are midpoints
pub(super) fn at(joint: Joint) -> DVec2 {
    if let Some([left, right]) = joint.middle_of() {
        return at(left).midpoint(at(right));
    }
    let (_, x, y) = FIGURE.iter().find(|(j, ..)| *j == joint).unwrap();
    DVec2::new(*x, *y)
}

/// Points of the figure in the order of a detector; points without a joint are at the top of the head
pub(super) fn points(layout: Layout) -> Vec<DVec2> {
    let mut points = vec![DVec2::new(200.0, 20.0); layout.point_count()];
    for &(joint, index) in layout.joints() {
        points[index] = at(joint);
    }
    if layout == Layout::MediaPipe33 {
        for (index, name) in MEDIAPIPE_NAMES.iter().enumerate() {
            let toes = name.replace("foot_index", "big_toe");
            if let Some(joint) = layout::joint_of_name(&toes) {
                points[index] = at(joint);
            }
        }
    }
    points
}

pub(super) fn join(numbers: impl IntoIterator<Item = f64>) -> String {
    let texts: Vec<String> = numbers.into_iter().map(|n| format!("{n:.6}")).collect();
    texts.join(", ")
}

/// Flat x, y and confidence
pub(super) fn triples(points: &[DVec2], confidence: f64) -> String {
    join(points.iter().flat_map(|p| [p.x, p.y, confidence]))
}

/// Rows of x and y
pub(super) fn rows(points: &[DVec2]) -> String {
    let rows: Vec<String> = points
        .iter()
        .map(|p| format!("[{}]", join([p.x, p.y])))
        .collect();
    format!("[{}]", rows.join(", "))
}

pub(super) fn relative(points: &[DVec2]) -> Vec<DVec2> {
    let size = DVec2::new(WIDTH as f64, HEIGHT as f64);
    points.iter().map(|&point| point / size).collect()
}

/// A list of objects with x and y
pub(super) fn objects(points: &[DVec2], more: impl Fn(usize) -> String) -> String {
    let object =
        |(index, p): (usize, &DVec2)| format!("{{\"x\": {}, \"y\": {}{}}}", p.x, p.y, more(index));
    let all: Vec<String> = points.iter().enumerate().map(object).collect();
    format!("[{}]", all.join(", "))
}

pub(super) fn openpose(key: &str, points: &[DVec2]) -> String {
    let numbers = triples(points, 0.75);
    format!("{{\"version\": 1.3, \"people\": [{{\"{key}\": [{numbers}]}}]}}")
}

/// The figure in every format: name, content, definition, number of joints found
pub(super) fn files() -> Vec<(&'static str, String, KeypointKind, usize)> {
    use KeypointKind::{Coco, MediaPipe, OpenPose};
    let [
        body25,
        body25b,
        coco18,
        mpi,
        coco,
        whole,
        halpe26,
        halpe136,
        landmarks,
    ] = [
        Layout::Body25,
        Layout::Body25B,
        Layout::Coco18,
        Layout::Mpi15,
        Layout::Coco17,
        Layout::WholeBody133,
        Layout::Halpe26,
        Layout::Halpe136,
        Layout::MediaPipe33,
    ]
    .map(points);
    let signed: Vec<DVec2> = relative(&body25).iter().map(|&p| p * 2.0 - 1.0).collect();
    let coco_flat = triples(&coco, 0.75);
    let scores = join(vec![0.75; 17]);
    let instance = format!(
        "{{\"keypoints\": {}, \"keypoint_scores\": [{scores}], \"bbox\": [[93, 20, 307, 558]], \"bbox_score\": 0.9}}",
        rows(&coco)
    );
    let visible = |_| ", \"z\": -0.1, \"visibility\": 0.99".to_owned();
    let by_name: Vec<String> = MEDIAPIPE_NAMES
        .iter()
        .zip(&landmarks)
        .map(|(n, p)| {
            format!(
                "\"{}\": {{\"x\": {}, \"y\": {}, \"z\": 0}}",
                n.to_uppercase(),
                p.x,
                p.y
            )
        })
        .collect();
    let coco_names = [
        "nose",
        "left_eye",
        "right_eye",
        "left_ear",
        "right_ear",
        "left_shoulder",
        "right_shoulder",
        "left_elbow",
        "right_elbow",
        "left_wrist",
        "right_wrist",
        "left_hip",
        "right_hip",
        "left_knee",
        "right_knee",
        "left_ankle",
        "right_ankle",
    ];
    let [xs, ys] = [
        join(coco.iter().map(|p| p.x)),
        join(coco.iter().map(|p| p.y)),
    ];
    let yolo = |columns: &str| format!("0 0.5 0.48 0.54 0.9 {}\n", columns.replace(',', ""));
    let names: Vec<String> = coco_names
        .iter()
        .enumerate()
        .map(|(i, n)| format!("\"{i}\": \"{n}\""))
        .collect();
    vec![
        (
            "openpose",
            openpose("pose_keypoints_2d", &body25),
            OpenPose,
            25,
        ),
        (
            "openpose 1.0",
            openpose("pose_keypoints", &body25),
            OpenPose,
            25,
        ),
        (
            "openpose with a bom",
            format!("\u{feff}{}", openpose("pose_keypoints_2d", &body25)),
            OpenPose,
            25,
        ),
        (
            "openpose 0 to 1",
            openpose("pose_keypoints_2d", &relative(&body25)),
            OpenPose,
            25,
        ),
        (
            "openpose -1 to 1",
            openpose("pose_keypoints_2d", &signed),
            OpenPose,
            25,
        ),
        (
            "openpose 25b",
            openpose("pose_keypoints_2d", &body25b),
            OpenPose,
            25,
        ),
        (
            "openpose coco",
            openpose("pose_keypoints_2d", &coco18),
            OpenPose,
            19,
        ),
        (
            "openpose mpi",
            openpose("pose_keypoints_2d", &mpi),
            OpenPose,
            14,
        ),
        (
            "openpose without confidences",
            format!(
                "{{\"people\": [{{\"pose_keypoints_2d\": [{}]}}]}}",
                join(body25.iter().flat_map(|p| [p.x, p.y]))
            ),
            OpenPose,
            25,
        ),
        (
            "openpose canvas",
            format!(
                "[{{\"people\": [{{\"pose_keypoints_2d\": [{}]}}], \"canvas_width\": 800, \"canvas_height\": 1200}}]",
                triples(&coco18.iter().map(|&p| p * 2.0).collect::<Vec<_>>(), 0.75)
            ),
            OpenPose,
            19,
        ),
        (
            "alphapose open",
            format!(
                "{{\"000.jpg\": {{\"version\": \"AlphaPose v0.3\", \"bodies\": [{{\"joints\": [{}]}}]}}}}",
                triples(&coco18, 0.75)
            ),
            OpenPose,
            19,
        ),
        (
            "alphapose",
            format!(
                "[{{\"image_id\": \"000.jpg\", \"category_id\": 1, \"keypoints\": [{coco_flat}], \"score\": 2.9, \"box\": [93, 20, 214, 538]}}]"
            ),
            Coco,
            19,
        ),
        (
            "alphapose halpe 26",
            format!(
                "[{{\"image_id\": \"000.jpg\", \"keypoints\": [{}]}}]",
                triples(&halpe26, 0.75)
            ),
            Coco,
            25,
        ),
        (
            "alphapose halpe 136",
            format!(
                "[{{\"image_id\": \"000.jpg\", \"keypoints\": [{}]}}]",
                triples(&halpe136, 0.75)
            ),
            Coco,
            25,
        ),
        (
            "coco results",
            format!("[{{\"image_id\": 42, \"keypoints\": [{coco_flat}], \"score\": 0.9}}]"),
            Coco,
            19,
        ),
        (
            "coco annotations",
            format!(
                "{{\"images\": [{{\"id\": 7, \"file_name\": \"000.jpg\", \"width\": 400, \"height\": 600}}], \"annotations\": [{{\"image_id\": 7, \"num_keypoints\": 17, \"keypoints\": [{}]}}]}}",
                triples(&coco, 2.0)
            ),
            Coco,
            19,
        ),
        (
            "coco annotations with feet",
            format!(
                "{{\"annotations\": [{{\"image_id\": 7, \"keypoints\": [{}], \"foot_kpts\": [{}]}}]}}",
                triples(&coco, 2.0),
                triples(&whole[17..23], 2.0)
            ),
            Coco,
            25,
        ),
        (
            "coco whole body",
            format!("[{{\"keypoints\": [{}]}}]", triples(&whole, 0.75)),
            Coco,
            25,
        ),
        ("mmpose inferencer", format!("[{instance}]"), Coco, 19),
        (
            "mmpose predictions",
            format!("{{\"predictions\": [[{instance}]], \"visualization\": []}}"),
            Coco,
            19,
        ),
        (
            "mmpose demo",
            format!(
                "{{\"meta_info\": {{\"keypoint_id2name\": {{{}}}}}, \"instance_info\": [{instance}]}}",
                names.join(", ")
            ),
            Coco,
            19,
        ),
        (
            "mmpose video",
            format!("{{\"instance_info\": [{{\"frame_id\": 1, \"instances\": [{instance}]}}]}}"),
            Coco,
            19,
        ),
        (
            "rtmlib arrays",
            format!(
                "{{\"keypoints\": [{}], \"scores\": [[{}]]}}",
                rows(&whole),
                join(vec![6.5; 133])
            ),
            Coco,
            25,
        ),
        ("bare arrays", format!("[{}]", rows(&halpe26)), Coco, 25),
        ("one array", rows(&coco), Coco, 19),
        ("flat numbers", format!("[{coco_flat}]"), Coco, 19),
        (
            "detectron2",
            format!(
                "{{\"instances\": {{\"pred_boxes\": [[1, 2, 3, 4]], \"scores\": [0.99], \"pred_keypoints\": [{}]}}}}",
                rows(&coco)
            ),
            Coco,
            19,
        ),
        (
            "vitpose",
            format!("{{\"000.jpg\": [{{\"keypoints\": {}}}]}}", rows(&coco)),
            Coco,
            19,
        ),
        (
            "tensorflow.js",
            format!(
                "[{{\"score\": 0.9, \"keypoints\": {}}}]",
                objects(&coco, |i| format!(
                    ", \"score\": 0.75, \"name\": \"{}\"",
                    coco_names[i]
                ))
            ),
            Coco,
            19,
        ),
        (
            "mediapipe",
            objects(&relative(&landmarks), visible),
            MediaPipe,
            23,
        ),
        (
            "mediapipe in px",
            format!(
                "{{\"landmarks\": {}}}",
                objects(&landmarks, |_| String::new())
            ),
            MediaPipe,
            23,
        ),
        (
            "mediapipe tasks",
            format!(
                "{{\"landmarks\": [{}], \"worldLandmarks\": [[]]}}",
                objects(&relative(&landmarks), visible)
            ),
            MediaPipe,
            23,
        ),
        (
            "mediapipe python",
            format!(
                "{{\"pose_landmarks\": {{\"landmark\": {}}}}}",
                objects(&relative(&landmarks), visible)
            ),
            MediaPipe,
            23,
        ),
        (
            "mediapipe javascript",
            format!(
                "{{\"poseLandmarks\": {}}}",
                objects(&relative(&landmarks), visible)
            ),
            MediaPipe,
            23,
        ),
        (
            "mediapipe by name",
            format!("{{{}}}", by_name.join(", ")),
            MediaPipe,
            23,
        ),
        (
            "mediapipe flat",
            format!(
                "[{}]",
                join(
                    relative(&landmarks)
                        .iter()
                        .flat_map(|p| [p.x, p.y, -0.2, 0.9])
                )
            ),
            MediaPipe,
            23,
        ),
        (
            "yolo text",
            yolo(&triples(&relative(&coco), 0.75)),
            Coco,
            19,
        ),
        (
            "yolo text with track",
            format!("{} 0.9 4\n", yolo(&triples(&relative(&coco), 0.75)).trim()),
            Coco,
            19,
        ),
        (
            "yolo text without confidences",
            yolo(&join(relative(&coco).iter().flat_map(|p| [p.x, p.y]))),
            Coco,
            19,
        ),
        (
            "yolo json",
            format!(
                "[{{\"name\": \"person\", \"class\": 0, \"confidence\": 0.9, \"box\": {{\"x1\": 93, \"y1\": 20}}, \"keypoints\": {{\"x\": [{xs}], \"y\": [{ys}], \"visible\": [{scores}]}}}}]"
            ),
            Coco,
            19,
        ),
    ]
}
