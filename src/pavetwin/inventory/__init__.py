"""The inventory of a road: detections of one defect in many images become one entry, and entries become files."""
