"""Figures of the paper's tables 2 to 4, to stand beside one's own.

Source: "Towards Domain Gap Bridging via Synthetic VIS Sensor Model", tables 2, 3 and 4; one run each, no intervals.
"""

PAPER = "the paper"
# arm -> domain -> measure of `visaug_train.tables.MEASURES`.
TABLES_2_3: dict[str, dict[str, dict[str, float]]] = {
    f"{PAPER}: baseline": {
        "speed": {"box_ap": 0.981, "iou": 0.9653, "keypoint_ap_paper": 0.987, "oks_paper": 0.9747},
        "lightbox": {"box_ap": 0.687, "iou": 0.8280, "keypoint_ap_paper": 0.472, "oks_paper": 0.6267},
        "sunlamp": {"box_ap": 0.627, "iou": 0.8349, "keypoint_ap_paper": 0.185, "oks_paper": 0.3928},
    },
    f"{PAPER}: + VIS sensor noise": {
        "speed": {"box_ap": 0.990, "iou": 0.9758, "keypoint_ap_paper": 0.994, "oks_paper": 0.9895},
        "lightbox": {"box_ap": 0.843, "iou": 0.8939, "keypoint_ap_paper": 0.634, "oks_paper": 0.7226},
        "sunlamp": {"box_ap": 0.723, "iou": 0.8682, "keypoint_ap_paper": 0.262, "oks_paper": 0.4587},
    },
}
# Whether its keypoint AP and OKS are by its own definition or by ultralytics', which has COCO's, it does not say.
for _domains in TABLES_2_3.values():
    for _scores in _domains.values():
        _scores |= {"keypoint_ap_coco": _scores["keypoint_ap_paper"], "oks_coco": _scores["oks_paper"]}
WHICH_OKS = (
    "The paper's keypoint figures stand in both columns: it defines an OKS of its own (sigma 1/11, area of the box), and trains "
    "with ultralytics, which prints COCO's; it does not say which of the two its tables hold."
)
# Target detection on SPEED's images: mean IoU and box AP50-95 where it is given.
TABLE_4 = {
    "SLAB baseline": (0.919, None),
    "UniAdelaide": (0.9534, None),
    "SLN (YOLOv5s)": (0.9538, 0.9851),
    "YOLOv5n": (0.9542, 0.957),
    "YOLOv5s": (0.9646, 0.976),
    f"{PAPER}: YOLOv8s-pose, baseline": (0.9653, 0.981),
    f"{PAPER}: YOLOv8s-pose, + VIS": (0.9758, 0.990),
}
