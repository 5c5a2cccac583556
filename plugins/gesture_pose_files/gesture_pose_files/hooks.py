"""Registers the readers of ready-made keypoint files."""

from gesture_core.plugin.hooks import Register, hookimpl

_PACKED = (".csv.gz", ".tsv.gz", ".txt.gz", ".csv.bz2", ".tsv.bz2", ".txt.bz2")


@hookimpl
def register_keypoint_readers(register: Register) -> None:
    register(
        "openpose-json",
        "gesture_pose_files.openpose_json:OpenPoseJsonReader",
        summary="a folder of OpenPose JSON, one numbered file a frame, versions 0.1 to 1.3",
        suffixes=(".json",),
        folders=True,
    )
    register(
        "result-list",
        "gesture_pose_files.result_list:ResultListReader",
        summary="one JSON file a clip, as AlphaPose, COCO's tools and MMPose write it",
        suffixes=(".json", ".json.gz", ".json.bz2"),
    )
    register(
        "json-table",
        "gesture_pose_files.json_table:JsonTableReader",
        summary="frames in JSON or JSON lines as people write them, MediaPipe's landmarks, tables of pandas",
        suffixes=(".json", ".jsonl", ".ndjson", ".json.gz", ".jsonl.gz", ".ndjson.gz"),
    )
    register(
        "arrays",
        "gesture_pose_files.arrays:ArrayReader",
        summary="keypoints in .npz or .npy arrays, COCO, BODY_25, MPI or MediaPipe layout",
        suffixes=(".npy", ".npz", ".npy.gz", ".npy.bz2", ".pkl", ".pickle", ".joblib"),
    )
    register(
        "array-frames",
        "gesture_pose_files.array_frames:ArrayFramesReader",
        summary="a folder with one numbered .npy a frame",
        suffixes=(".npy",),
        folders=True,
    )
    register(
        "arrow-table",
        "gesture_pose_files.arrow_table:ArrowTableReader",
        summary="keypoints in Parquet or Feather, as data-frame libraries write them",
        suffixes=(".parquet", ".feather", ".arrow"),
    )
    register(
        "matlab",
        "gesture_pose_files.matlab:MatlabReader",
        summary="one array of keypoints in a .mat of MATLAB",
        suffixes=(".mat",),
    )
    register(
        "yolo-text",
        "gesture_pose_files.yolo_text:YoloTextReader",
        summary="a folder of the text files of Ultralytics, one numbered file a frame",
        suffixes=(".txt",),
        folders=True,
    )
    register(
        "csv",
        "gesture_pose_files.csv_table:CsvReader",
        summary="keypoints in CSV or text, with or without a header",
        suffixes=(".csv", ".tsv", ".txt", *_PACKED),
    )
    register(
        "deeplabcut-csv",
        "gesture_pose_files.deeplabcut:DeepLabCutCsvReader",
        summary="the CSV files of DeepLabCut, of one individual or several",
        suffixes=(".csv", ".tsv", *_PACKED),
    )
    register(
        "hdf5",
        "gesture_pose_files.hdf5:Hdf5Reader",
        needs=("h5py",),
        extra="hdf5",
        summary="analysis files of SLEAP and tables of DeepLabCut in HDF5",
        suffixes=(".h5", ".hdf5"),
    )
    register(
        "pose-format",
        "gesture_pose_files.pose_format_file:PoseFormatReader",
        needs=("pose_format",),
        extra="pose-format",
        summary="the .pose files of pose-format",
        suffixes=(".pose",),
    )
    register(
        "trc",
        "gesture_pose_files.trc:TrcReader",
        summary="marker files of Sports2D and Pose2Sim (OpenSim's .trc)",
        suffixes=(".trc",),
    )
    register(
        "bvh",
        "gesture_pose_files.bvh:BvhReader",
        summary="motion captures as trees of bones (.bvh)",
        suffixes=(".bvh",),
    )
    register(
        "c3d",
        "gesture_pose_files.c3d_file:C3dReader",
        needs=("c3d",),
        extra="c3d",
        summary="markers of motion captures (.c3d)",
        suffixes=(".c3d",),
    )
    register(
        "series",
        "gesture_pose_files.series:SeriesReader",
        summary="channels of sensors: CSV, Parquet, .npy, .npz, WAV; .ts, .arff and .tsv of UCR and UEA",
        suffixes=(".csv", ".tsv", ".txt", ".dat", ".parquet", ".npy", ".npz", ".wav", ".ts", ".arff"),
        folders=True,
        channels=True,
    )
