"""What all labelled images share, rendered or photographed: classes, boxes and masks."""
