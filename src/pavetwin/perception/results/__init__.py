"""From detections to files: sizes, places on the earth, annotated pictures, and the forms of other programs."""
