"""The whole transducer: what each effect that the thesis left out does to its sensor."""
