"""German texts of a report by their English form, names of quantities, and phrases within places and sources."""

from __future__ import annotations

from collections.abc import Mapping

TEXTS: Mapping[str, str] = {
    # titles
    "Line profile": "Längenschnitt",
    "Rope tension": "Seilzugkraft",
    "Tower loads": "Stützenlasten",
    "Key figures": "Kennwerte",
    "Rules": "Regeln",
    "Load cases": "Lastfälle",
    "Over time": "Zeitverläufe",
    "Study": "Studie",
    "a study": "eine Studie",
    "varied key": "veränderte Eingabe",
    "range or values": "Bereich oder Werte",
    "Ranges over all cases": "Bereiche über alle Fälle",
    "cases with it": "Fälle damit",
    "Sobol indices": "Sobol-Indizes",
    "first-order": "erster Ordnung",
    "total": "gesamt",
    "interval of 95 %": "Bereich von 95 %",
    "Wide intervals mean that there are too few cases; estimates may then be below 0 or above 1.": (
        "Weite Bereiche bedeuten zu wenige Fälle; Schätzwerte können dann unter 0 oder über 1 liegen."
    ),
    "study": "Studie",
    "study made by": "Studie erstellt mit",
    "Rope life": "Seillebensdauer",
    "Assumptions": "Annahmen",
    "Inputs, versions and use": "Eingaben, Versionen und Verwendung",
    "Sags": "Durchhänge",
    "Clearances": "Bodenabstände",
    "Clearance over the terrain": "Abstand vom Gelände",
    "Tension": "Seilzugkraft",
    "Where the profiles differ": "Worin sich die Regelwerke unterscheiden",
    "Assumed inputs": "Angenommene Eingaben",
    "Assumed limits": "Angenommene Grenzwerte",
    "Assumed defaults": "Angenommene Vorgaben",
    "Intended use": "Verwendungszweck",
    "Inputs with a remark": "Eingaben mit Vermerk",
    "Results and versions": "Ergebnisse und Versionen",
    # head
    "report": "Bericht",
    "Report of": "Bericht über",
    "a run": "einen Lauf",
    "load cases at rest": "Lastfälle in Ruhe",
    "load cases at rest and in motion": "Lastfälle in Ruhe und in Bewegung",
    "in motion": "in Bewegung",
    "Limits": "Grenzwerte",
    "Made": "Erstellt",
    "limits are kept": "Grenzwerten sind eingehalten",
    "no key figure has a limit": "kein Kennwert hat einen Grenzwert",
    "not judged here": "hier nicht beurteilt",
    "cases miss a limit": "Fällen halten einen Grenzwert nicht ein",
    "of": "von",
    "The command that made this page:": "Befehl, mit dem diese Seite erstellt wurde:",
    # tables
    "key figure": "Kennwert",
    "value": "Wert",
    "values": "Werte",
    "as above": "wie oben",
    "unit": "Einheit",
    "limit": "Grenzwert",
    "verdict": "Urteil",
    "governing case": "maßgebender Lastfall",
    "when and where": "wann und wo",
    "Sources of the limits:": "Quellen der Grenzwerte:",
    "Ways of sampling:": "Abtastung:",
    "figures with it": "Anzahl",
    "input": "Eingabe",
    "remark in the scenario": "Vermerk im Szenario",
    "tower": "Stütze",
    "load": "Last",
    "lowest place": "tiefste Lage",
    "highest": "größte",
    "lowest": "kleinste",
    "mean": "Mittel",
    "standard deviation": "Standardabweichung",
    "along the track": "in Bahnrichtung",
    "to the left": "nach links",
    "downwards": "nach unten",
    "case": "Lastfall",
    "stands for": "steht für",
    "changes": "Änderungen",
    "extremes that it governs": "maßgebend für Extremwerte",
    "and further cases:": "und weitere Lastfälle:",
    "command": "Befehl",
    "no command": "kein Befehl",
    "and further commands:": "und weitere Befehle:",
    "meaning": "Bedeutung",
    "why": "warum",
    "quantity": "Größe",
    "no rule": "keine Regel",
    "that is": "das ist",
    "Nothing keeps both:": "Beides zugleich ist nicht einzuhalten:",
    "a stop from the rated speed within this distance": "ein Halt aus der Nenngeschwindigkeit auf diesem Weg",
    "a stop downhill": "ein Halt bei Talfahrt",
    "Only": "Nur",
    "has a rule on:": "hat eine Regel über:",
    "rule": "Regel",
    "clause": "Fundstelle",
    "text": "Forderung",
    "figure": "Kennwert",
    "check": "Prüfung",
    "checks": "Prüfungen",
    "more no figure decides": "weitere entscheidet kein Kennwert",
    # verdicts and limits
    "kept": "eingehalten",
    "not kept": "nicht eingehalten",
    "not decided": "nicht entschieden",
    "not judged": "nicht beurteilt",
    "is not given": "ist nicht angegeben",
    "the run has no such key figure": "der Lauf hat keinen solchen Kennwert",
    "the run begins in motion, and its tension at rest is not known": (
        "der Lauf beginnt in Bewegung, und seine Zugkraft in Ruhe ist nicht bekannt"
    ),
    "authority may allow": "Behörde kann zulassen",
    "does not apply": "trifft nicht zu",
    "do not apply": "treffen nicht zu",
    "at most": "höchstens",
    "at least": "mindestens",
    "below": "unter",
    "above": "über",
    "within": "innerhalb",
    "to": "bis",
    "start": "Anfang",
    "end": "Ende",
    "its": "ihrer",
    "the": "der",
    "vehicles": "Fahrzeugen",
    "a": "einer",
    "a rope": "ein Seil",
    # sentences
    "Numbers at the bottom are the largest sags of the spans in m. Heights and lengths have different scales.": (
        "Die Zahlen unten sind die größten Durchhänge der Seilfelder in m. Höhen und Längen haben verschiedene "
        "Maßstäbe."
    ),
    "Solid ropes: at the start; dashed: lowest in the run.": (
        "Seile ausgezogen: am Anfang; gestrichelt: tiefste Lage im Lauf."
    ),
    "Solid ropes: in the state that governs most of what is drawn; dashed: lowest of all states that are drawn.": (
        "Seile ausgezogen: im Zustand, der das meiste Gezeichnete bestimmt; gestrichelt: tiefste Lage aller "
        "gezeichneten Zustände."
    ),
    "Arrows: force of the rope on each tower when it was highest, those of one rope drawn to one scale, along the "
    "track and upright.": (
        "Pfeile: größte Kraft des Seils auf jede Stütze, die eines Seils in einem Maßstab, in Bahnrichtung "
        "und lotrecht."
    ),
    "Components are those of the frame with that load.": "Komponenten im Augenblick dieser Last.",
    "Components are those of the governing case with that load; of a case in motion, at the instant of that load.": (
        "Komponenten im maßgebenden Lastfall; bei einem bewegten im Augenblick dieser Last."
    ),
    "Lines and dashes are of cases at rest, those of their largest sags, least clearances, and extreme tensions and "
    "tower loads. Points and tables have the cases in motion too.": (
        "Linien und Striche sind von Lastfällen in Ruhe, denen mit deren größten Durchhängen, kleinsten Abständen "
        "und größten oder kleinsten Zugkräften und Stützenlasten. Punkte und Tabellen enthalten auch die Lastfälle "
        "in Bewegung."
    ),
    "Lowest and highest tension of all load cases and places of the vehicle at each place of the rope, those in motion "
    "included.": (
        "Kleinste und größte Zugkraft aller Lastfälle und Stellungen des Fahrzeugs an jeder Stelle des Seils, auch der "
        "Lastfälle in Bewegung."
    ),
    "Rules are in the words of this program and not in those of the documents. Whether a document is in force today "
    "was not verified.": (
        "Regeln stehen in den (englischen) Worten dieses Programms und nicht in denen der Vorschriften. Ob eine "
        "Vorschrift heute gilt, wurde nicht geprüft."
    ),
    "This report is of one run, which is one load case. Whether it is the worst one is not known from it; `envelope` "
    "compares load cases.": (
        "Dieser Bericht behandelt einen Lauf, also einen Lastfall. Ob er der ungünstigste ist, geht daraus nicht "
        "hervor; `envelope` vergleicht Lastfälle."
    ),
    "Counts alone: no life in trips or years is calculated, as no formula of rope life with its constants was found in "
    "a source that can be read.": (
        "Nur Zählwerte: eine Lebensdauer in Fahrten oder Jahren wird nicht berechnet, da keine Formel der "
        "Seillebensdauer mit ihren Konstanten in einer lesbaren Quelle gefunden wurde."
    ),
    "A trip is once round the loop of": "Eine Fahrt ist ein Umlauf der Schleife von",
    "A trip is there and back, together": "Eine Fahrt ist hin und zurück, zusammen",
    "trips in this run by the travel of the rope:": "Fahrten in diesem Lauf nach dem Weg des Seils:",
    "Bending cycles of the most bent rope point in a trip, straight to bent to straight:": (
        "Biegewechsel der am meisten gebogenen Seilstelle je Fahrt, gerade - gebogen - gerade:"
    ),
    "over bullwheels and": "über Seilscheiben und",
    "over sheaves of towers": "über Stützenrollen",
    "in a year of": "in einem Jahr mit",
    "trips:": "Fahrten:",
    "and": "und",
    "passed": "überlaufen",
    "sheaves": "Rollen",
    "diameter": "Durchmesser",
    "over that of the rope": "zu dem des Seils",
    "angle each": "Winkel je Rolle",
    "cycles in a trip": "je Fahrt",
    "in a year": "je Jahr",
    "tension, lowest": "Zugkraft, kleinste",
    "This rope does not run over bullwheels. Wheels of vehicles bend it, which is not counted.": (
        "Dieses Seil läuft nicht über Seilscheiben. Die Räder der Fahrzeuge biegen es, was nicht gezählt wird."
    ),
    "range of tension [kN]": "Schwingbreite der Zugkraft [kN]",
    "cycles in this run": "Schwingspiele in diesem Lauf",
    "Cycles by rainflow counting (ASTM E1049-85), half cycles as 0.5, of the rope point with the largest range of 64 "
    "that are followed. In a trip: along the mean tension of the run, without what happens in time as stops, which a "
    "trip may have besides. In this run: over time at the point, of the frames in which the log has the ropes.": (
        "Schwingspiele nach dem Rainflow-Verfahren (ASTM E1049-85), halbe als 0.5, an der Seilstelle mit der größten "
        "Schwingbreite von 64 verfolgten. Je Fahrt: entlang der mittleren Zugkraft des Laufs, ohne zeitliche Vorgänge "
        "wie Halte, die eine Fahrt außerdem haben kann. In diesem Lauf: über die Zeit, in den Augenblicken, in denen "
        "die Aufzeichnung die Seile hat."
    ),
    "It models these load cases of rules:": "Er bildet diese Lastfälle von Regeln ab:",
    "inputs are marked assumed or have no source.": "Eingaben sind als angenommen bezeichnet oder ohne Quelle.",
    "The scenario says:": "Das Szenario sagt:",
    "Assumed ways of sampling:": "Angenommene Abtastung:",
    "set for this run": "für diesen Lauf gesetzt",
    "no source stated": "keine Quelle angegeben",
    "Results of a calculation, for engineers who judge them. They are no approval and no proof of safety, and stand "
    "for the stated model, inputs and load cases alone; a figure that keeps its limit does so in these. What is marked "
    "assumed is to be replaced by what is known of the installation.": (
        "Ergebnisse einer Berechnung, für Fachleute, die sie beurteilen. Sie sind weder Genehmigung noch "
        "Sicherheitsnachweis und gelten nur für das angegebene Modell, seine Eingaben und Lastfälle; ein Kennwert hält "
        "seinen Grenzwert in diesen ein. Angenommenes ist durch das zu ersetzen, was von der Anlage bekannt ist. "
        "Dezimalzeichen ist der Punkt."
    ),
    "Remarks are those of the scenario file": "Die Vermerke stammen aus der Szenariodatei",
    "The scenario file with its remarks is not at hand; --scenario names it.": (
        "Die Szenariodatei mit ihren Vermerken liegt nicht vor; --scenario nennt sie."
    ),
    # drawings
    "x, along the track [m]": "x, in Bahnrichtung [m]",
    "z, height [m]": "z, Höhe [m]",
    "clearance [m]": "Abstand [m]",
    "terrain": "Gelände",
    "rope, least": "Seil, kleinster",
    "limit of the rope": "Grenzwert des Seils",
    "limit of vehicles": "Grenzwert der Fahrzeuge",
    "arc length of the rope, unstrained [m]": "Bogenlänge des Seils, ungedehnt [m]",
    "tension [kN]": "Seilzugkraft [kN]",
    "safety factor of": "Sicherheit",
    "time [s]": "Zeit [s]",
    "vehicle at": "Fahrzeug bei",
    # plots over time
    "Speed and place along the rope": "Geschwindigkeit und Ort am Seil",
    "Swing along the track": "Längspendeln",
    "Across the track: swing, place, wind": "Quer zur Bahn: Pendeln, Ort, Wind",
    "Drive": "Antrieb",
    "Bullwheels": "Seilscheiben",
    "Forces on carriages and supports": "Kräfte auf Laufwerke und Auflager",
    "Lateral forces of towers": "Seitenkräfte der Stützen",
    "speed": "Geschwindigkeit",
    "commanded": "befohlen",
    "reference": "Sollwert",
    "arc length": "Bogenlänge",
    "tension": "Seilzugkraft",
    "pitch": "Längspendelwinkel",
    "roll": "Querpendelwinkel",
    "y, to the left": "y, nach links",
    "wind": "Wind",
    "force": "Kraft",
    "share of the force limit": "Anteil der Grenzkraft",
    "power": "Leistung",
    "torque": "Drehmoment",
    "tension of strands": "Zugkraft der Stränge",
    "incoming strand": "auflaufender Strang",
    "outgoing strand": "ablaufender Strang",
    "at the start": "am Anfang",
    "at the end": "am Ende",
    "along": "längs",
    "from the right": "von rechts",
    "up": "nach oben",
    "adhesion used": "ausgenutzte Reibung",
    "slip of the rope": "Schlupf des Seils",
    "travel of the tensioning device": "Weg der Spanneinrichtung",
    "rope on carriage": "Seil auf Laufwerk",
    "haul rope on carriage": "Zugseil auf Laufwerk",
    "haul rope of": "Zugseil von",
    "support on rope": "Auflager auf Seil",
    "counterweight travel": "Weg des Spanngewichts",
    "pantograph on rope": "Stromabnehmer auf Seil",
    "tower on rope, to the left": "Stütze auf Seil, nach links",
    # origin
    "log": "Aufzeichnung",
    "begin of the run": "Beginn des Laufs",
    "run made by": "Lauf erstellt mit",
    "run made on": "Lauf erstellt auf",
    "envelope": "Umhüllende",
    "envelope made by": "Umhüllende erstellt mit",
    "drawn": "gezeichnet",
    "scenario": "Szenario",
}

QUANTITIES: Mapping[str, str] = {
    "rope_tension": "Seilzugkraft",
    "rope_safety_factor": "Seilsicherheit",
    "dynamic_amplification": "dynamischer Faktor, Zugkraft zu der am Anfang",
    "sag": "Durchhang unter der Sehne{}",
    "rope_clearance": "Bodenabstand des Seils",
    "support_load": "Auflagerkraft",
    "load_along_track": "Kraft in Bahnrichtung",
    "load_downwards": "Kraft lotrecht nach unten",
    "deropement_margin": "Reserve gegen Abheben, Last zu der in Ruhe",
    "roller_load": "Rollenlast, kleinste",
    "lateral_force": "Seitenkraft des Seils",
    "lateral_ratio": "Seitenkraft zu Normalkraft",
    "derailed": "Seil entgleist",
    "counterweight_travel": "Weg des Spanngewichts",
    "hydraulics_travel": "Weg der hydraulischen Spanneinrichtung",
    "hydraulics_pull": "Zug der hydraulischen Spanneinrichtung",
    "speed": "Geschwindigkeit",
    "drive_speed": "Geschwindigkeit am Antrieb",
    "drive_force": "Antriebskraft",
    "drive_power": "Antriebsleistung",
    "brake_force": "Bremskraft",
    "stopping_distance": "Anhalteweg",
    "stopping_time": "Anhaltezeit",
    "mean_deceleration": "mittlere Verzögerung beim Anhalten",
    "restart_delay": "Wartezeit bis zum Wiederanfahren",
    "passenger_stopping_distance": "Anhalteweg der Fahrgäste",
    "end_stop_speed": "Geschwindigkeit beim Auffahren auf den Endanschlag",
    "acceleration": "Beschleunigung des Fahrzeugs",
    "swing": "Längspendeln",
    "lateral_swing": "Querpendeln",
    "tower_clearance": "Abstand von Stützen",
    "contact_force": "Kontaktkraft",
    "haul_force": "Zugseilkraft",
    "tension_per_transverse_load": "Zugkraft zu Querlast",
    "vehicle_clearance": "Bodenabstand",
    "vehicle_separation": "Abstand zwischen {}, kleinster",
    "buffer_force": "Pufferkraft, größte",
    "clamp_force": "Zug {} Klemme in Bahnrichtung, größter",
    "connector_force": "Zug, größter",
    "connector_slack": "schlaff, längste Dauer",
    "pantograph_force": "Kontaktkraft",
    "contact_loss": "Kontaktverlust, Anteil der Zeit",
    "carried_load": "Last der Fahrzeuge, größte",
    "strand_tension": "Zugkraft von '{}'",
    "adhesion_used": "ausgenutzte von verfügbarer Reibung",
    "rope_slip": "Schlupf des Seils",
    "rollback": "Rücklaufsicherung ausgelöst",
    "drive_torque": "Antriebsmoment, größtes",
    "wind": "Wind",
    "energy_lost": "Energieverlust oder -gewinn des Rechenverfahrens",
    "swing_tangent": "Längsneigung, Tangens",
    "lateral_swing_tangent": "Querneigung, Tangens",
    "calculated_safety_factor": "Sicherheit auf die rechnerische Bruchkraft",
    "tested_safety_factor": "Sicherheit auf die geprüfte Bruchkraft",
    "tension_over_load": "kleinste Zugkraft zu größter Querlast",
    "moving_clearance": "Bodenabstand bewegter Teile",
    "load_ratio": "kleinste zu größter Last",
    "rope_deflection": "Ablenkwinkel des Seils",
    "roller_pressure": "Rollenlast zu Metallquerschnitt",
    "wheel_pressure": "Radlast zu Metallquerschnitt",
    "wheel_load_ratio": "Radlast zu kleinster Zugkraft",
    "radius_ratio": "Radius zu Seildurchmesser",
    "diameter_ratio": "Durchmesser zu Seildurchmesser",
    "wire_ratio": "Durchmesser zu dem des dicksten Drahts",
    "saddle_acceleration": "größte Geschwindigkeit zum Quadrat zu Radius",
    "carrier_interval": "Folgezeit der Fahrzeuge",
    "boarding_speed": "Geschwindigkeit, unter der ein Fahrzeug bestiegen wird",
    "brake_hold": "Tragseilbremse zu Hangabtrieb",
    "grip_slip_safety": "Abziehkraft der Klemme zu ihrem Zug",
    "mass_per_person": "Nutzlast je Person",
    "saddle_friction": "Reibung in Seilrichtung",
    "wind_pressure": "Staudruck des Winds",
    "slope": "Neigung der Sehnen",
    "drive_acceleration": "Beschleunigung des Antriebs",
    "drive_deceleration": "Verzögerung des Antriebs",
}

# within places, sources and ways of sampling, in this order
PHRASES: Mapping[str, str] = {
    "case ": "Lastfall ",
    "emergency stop from": "Nothalt aus",
    "emergency stop, until the last vehicle stands still": "Nothalt, bis das letzte Fahrzeug steht",
    "service stop from": "Betriebshalt aus",
    "of the rim of its bullwheel": "am Umfang der Seilscheibe",
    "of its clamp along the rope": "der Klemme am Seil",
    "its load along the rope, swing included": "der Last am Seil, mit Pendeln",
    "not over: still": "nicht beendet: noch",
    ", not over": ", nicht beendet",
    "stands for yes": "steht für ja",
    "for no": "für nein",
    "carriers and payload": "Fahrzeuge und Nutzlast",
    "no wind": "kein Wind",
    "rope travel": "Seilweg",
    "rim travel": "Weg am Scheibenumfang",
    "arc length": "Bogenlänge",
    "runs onto it": "läuft auf",
    "runs off it": "läuft ab",
    "does not touch": "berührt nicht",
    "mean of": "Mittel von",
    " rollers": " Rollen",
    "judged after": "beurteilt nach",
    "sampled at every solver step": "in jedem Rechenschritt abgetastet",
    "sampled at every frame, unfiltered; EN 50318 filters it with a low-pass of 20 Hz": (
        "in jedem Bild abgetastet, ungefiltert; EN 50318 filtert mit einem Tiefpass von 20 Hz"
    ),
    "samples taken every": "abgetastet alle",
    "smoothed twice with a moving average over": "zweimal mit einem gleitenden Mittel geglättet über",
    "assumed, as no ropeway standard specifies a filter": "angenommen, da keine Seilbahnnorm einen Filter nennt",
    "EN 12927 and CEN practice: 3.15 to 3.5 track rope, 4.5 to 5 haul rope": (
        "EN 12927 und CEN-Praxis: 3.15 bis 3.5 Tragseil, 4.5 bis 5 Zugseil"
    ),
    "CEN practice for carriages that roll on a track rope, at least": (
        "CEN-Praxis für Laufwerke, die auf einem Tragseil rollen, mindestens"
    ),
    "Vorarlberg's ordinance on ropeways": "Vorarlberger Seilbahnverordnung",
    "nothing may touch the ground": "nichts darf den Boden berühren",
    "clearance usually allows for": "Lichtraum gewöhnlich für",
    "emergency stops usually have": "Nothalte haben gewöhnlich",
    "a tenth of the load in equilibrium; the cable lifts off at 0": "ein Zehntel der Ruhelast; bei 0 hebt das Seil ab",
    "500 N on each sheave, so that a swinging rope stays on it": "500 N je Rolle, damit ein schwingendes Seil bleibt",
    "equivalent to a damping ratio of 0.08 %, less than that of the rope itself": (
        "entspricht einem Dämpfungsgrad von 0.08 %, weniger als dem des Seils"
    ),
    "flanks of 45 degrees with a friction of 0.3 hold up to": "Flanken von 45 Grad mit Reibung 0.3 halten bis",
    "reach of a passenger who leans out, with a reserve": "Reichweite eines Fahrgasts beim Hinauslehnen, mit Reserve",
    "the rope stays on its towers": "das Seil bleibt auf den Stützen",
    "above 1 the rope slips on the wheel; from 1 mm on, `slip of the rope` gives the distance": (
        "über 1 rutscht das Seil; ab 1 mm nennt `Schlupf des Seils` den Weg"
    ),
    "friction ": "Reibung ",
    " wind ": " Wind ",
    " m/s to ": " m/s nach ",  # direction of the wind
    " upwards": " aufwärts",
    " downwards": " abwärts",
    " times wrap ": " mal Umschlingung ",
    "assumed: ": "angenommen: ",
    "scenario: ": "Szenario: ",
    " to ": " bis ",
    " at ": " bei ",
    " from ": " ab ",
    " of ": " von ",
}
