"""Real-image datasets: public ones and one's own, converted into one common form. Its parts are imported where used."""
